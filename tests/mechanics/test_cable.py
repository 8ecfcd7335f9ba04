"""Cables: the paper's direction, a closed form, slackness, friction, and exact derivatives.

Navarro et al. 2020, eq. 3: the cable pulls guide i along the sum of the unit vectors to its neighbours, and
eq. 4 distributes that over the nodes of the guide's element by its barycentric coordinates.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.errors import MeshError, SolveError
from softfuse.functional.cable import guide_forces, length
from softfuse.functional.material_points import MaterialPoints
from softfuse.material import NeoHookean
from softfuse.mechanics import RESULTS, Loads, Newton, State, solve
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mechanics.dense import Dense

LENGTH, SIDE, YOUNG = 0.06, 0.012, 3e5
GUIDES = np.array([[x, 0.0045, 0.002] for x in (0.012, 0.027, 0.041, 0.055)])
PULLED_AT = np.array([-0.004, 0.0065, 0.003])

_solve = eqx.filter_jit(solve)


@pytest.fixture(scope="module")
def beam(box) -> Body:
    """60 × 12 × 12 mm, held at x = 0."""
    mesh = mesh_for(LINEAR, box(np.linspace(0, LENGTH, 11), *(2 * [np.linspace(0, SIDE, 3)])))
    return Body.from_mesh(mesh, [NeoHookean.from_young(YOUNG, 0.3)], mesh.nodes[:, 0] == 0.0, element=LINEAR)


@pytest.fixture(scope="module")
def pulled(beam) -> PulledCable:
    return PulledCable.through(beam, GUIDES, PULLED_AT)


@pytest.fixture(scope="module")
def shortened(beam, pulled) -> ShortenedCable:
    return ShortenedCable.of(pulled, beam)


def rest_length(cable: PulledCable) -> float:
    return float(length(cable.ports.points.location, cable.pulled_at))


def _equilibrium(body: Body, cable, drive: float):
    loads = Loads((cable,))
    found = _solve(Newton(Dense.plan(body)), body, loads, jnp.array([drive]), State.rest(body, loads))
    assert found.result == RESULTS.converged
    return found.state


def test_guides_are_where_they_were_put(beam, pulled, generic) -> None:
    at_rest = pulled.ports.values(beam, jnp.zeros(beam.n)).reshape(-1, 3)
    np.testing.assert_allclose(at_rest, GUIDES, atol=1e-15)
    z = generic(beam, 0)
    np.testing.assert_allclose(
        pulled.ports.values(beam, z) - at_rest.ravel(), pulled.ports.rows(beam, z).T @ z, atol=1e-15
    )


def test_the_length_falls_along_the_direction_of_the_paper(beam, pulled, generic) -> None:
    """∂δ_c/∂q with δ_c = −ℓ: unit vectors to the neighbours times barycentric weights, by numpy."""
    z = generic(beam, 1)
    q = np.asarray(beam.rest + beam.displacement(z))
    points = pulled.ports.points
    shape = np.asarray(points.shape(beam.rest))
    nodes = np.asarray(points.nodes)
    at = np.vstack([PULLED_AT, np.einsum("ga,gai->gi", shape, q[nodes])])
    expected = np.zeros_like(q)
    for i in range(1, len(at)):
        pull = (at[i - 1] - at[i]) / np.linalg.norm(at[i - 1] - at[i])
        if i + 1 < len(at):
            pull = pull + (at[i + 1] - at[i]) / np.linalg.norm(at[i + 1] - at[i])
        for weight, node in zip(shape[i - 1], nodes[i - 1], strict=True):
            expected[node] += weight * pull

    def shortening(positions):
        x = jnp.einsum("ga,gai->gi", points.shape(beam.rest), positions[points.nodes])
        return -length(x, pulled.pulled_at)

    np.testing.assert_allclose(jax.grad(shortening)(jnp.asarray(q)), expected, rtol=0, atol=1e-13)
    # The same nodal forces as the load puts on the body for a tension of 1 N.
    forces = guide_forces(jnp.asarray(at[1:]), pulled.pulled_at, jnp.array(1.0), jnp.array(0.0))
    pushed = np.append(pulled.ports.rows(beam, z) @ forces.ravel(), 0.0)[np.asarray(beam.displacement_index)]
    free = np.asarray(beam.displacement_index) < beam.n
    np.testing.assert_allclose(pushed[free], expected[free], rtol=0, atol=1e-13)


def test_friction_follows_euler_and_eytelwein() -> None:
    """Around half a circle of many guides the tension falls by exp(−μ π)."""
    turn = np.linspace(0.0, np.pi, 400)
    circle = jnp.asarray(np.stack([np.sin(turn), 1 - np.cos(turn), 0 * turn], axis=1))
    start, friction = jnp.array([-1.0, 0.0, 0.0]), 0.3
    forces = guide_forces(circle, start, jnp.array(2.0), jnp.array(friction))
    # The last guide holds the end of the cable with what is left of the tension.
    np.testing.assert_allclose(np.linalg.norm(forces[-1]), 2 * np.exp(-friction * np.pi), rtol=2e-3)
    # What all guides feel together is what pulls at both ends of the cable.
    np.testing.assert_allclose(jnp.sum(forces, axis=0), [-2.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.slow
def test_tension_and_shortening_are_each_others_inverse(beam, pulled, shortened) -> None:
    by_length = _equilibrium(beam, shortened, 0.004)
    tension = float(by_length.internal[0])
    assert tension > 0.1
    by_force = _equilibrium(beam, pulled, tension)
    np.testing.assert_allclose(by_force.z, by_length.z, rtol=0, atol=1e-9 * np.abs(by_length.z).max())
    guides = pulled.ports.values(beam, by_length.z).reshape(-1, 3)
    left = float(length(guides, pulled.pulled_at))
    np.testing.assert_allclose(rest_length(pulled) - left, 0.004, atol=1e-12)


def test_a_shortened_cable_is_the_one_pulled_with_its_tension(beam, pulled) -> None:
    shorter = pulled.by_answer(beam)
    assert shorter.sizes.internal == shorter.sizes.drives == 1
    internal, drive = Loads((pulled, shorter, pulled)).by_force(jnp.array([3.0]), jnp.array([1.0, 4e-3, 2.0]))
    assert internal.size == 0 and drive.tolist() == [1.0, 3.0, 2.0]
    with pytest.raises(SolveError, match="ShortenedCable is not driven by what answers it"):
        shorter.by_answer(beam)


def test_the_tip_moves_towards_the_cable(beam, shortened) -> None:
    state = _equilibrium(beam, shortened, 0.004)
    tip = np.asarray(beam.displacement(state.z))[np.isclose(np.asarray(beam.rest)[:, 0], LENGTH)]
    assert tip[:, 2].mean() < -0.005 and tip[:, 0].mean() < 0


def test_a_slack_cable_carries_nothing(beam, shortened) -> None:
    state = _equilibrium(beam, shortened, -0.002)
    np.testing.assert_array_equal(state.force, 0.0)
    np.testing.assert_array_equal(state.internal, 0.0)
    np.testing.assert_array_equal(state.z, 0.0)


def test_a_soft_cable_stretches(beam, pulled) -> None:
    soft = PulledCable.through(beam, GUIDES, PULLED_AT, friction=0.2, compliance=2e-3)
    state = _equilibrium(beam, ShortenedCable.of(soft, beam), 0.004)
    guides = pulled.ports.values(beam, state.z).reshape(-1, 3)
    stretched = float(length(guides, pulled.pulled_at) - (rest_length(pulled) - 0.004))
    np.testing.assert_allclose(stretched, 2e-3 * float(state.internal[0]), rtol=1e-9)
    # What a cable of given tension is pulled out by is the same.
    out = soft.conjugate(state.force, jnp.zeros(0), guides.ravel())
    np.testing.assert_allclose(out, 0.004, rtol=1e-9)


def test_a_guide_in_the_air_is_refused(beam) -> None:
    guides = np.array([[0.01, 0.004, 0.002], [0.02, -0.001, 0.002], [0.02, 0.004, -0.0003]])
    told = (
        r"guide 1 at \(20, -1, 2\) mm lies outside the body by 1 mm \(nearest place \(20, 0, 2\) mm\); "
        r"guide 2 at \(20, 4, -0.3\) mm lies outside the body by 0.3 mm"
    )
    with pytest.raises(MeshError, match=told):
        PulledCable.through(beam, guides, PULLED_AT)
    with pytest.raises(MeshError, match="guide 1 .* lies outside the body by 1 mm [^;]*: move"):
        PulledCable.through(beam, guides, PULLED_AT, within=0.0005)


def test_guides_slightly_outside_are_put_onto_the_surface(beam, caplog) -> None:
    guides = np.array([[0.01, 0.004, 0.002], [0.02, -0.001, 0.002], [0.02, 0.004, -0.0003]])
    cable = PulledCable.through(beam, guides, PULLED_AT, within=0.0011)
    on = np.maximum(guides, 0.0)
    np.testing.assert_allclose(cable.ports.location, on, atol=1e-12)
    np.testing.assert_allclose(cable.ports.values(beam, jnp.zeros(beam.n)).reshape(-1, 3), on, atol=1e-12)
    assert "guide 1 at (20, -1, 2) mm lies outside the body by 1 mm" in caplog.text
    assert "onto its surface" in caplog.text


def test_an_anchor_that_reaches_out_of_the_body_is_told_with_its_room(beam) -> None:
    guides = np.array([[0.01, 0.004, 0.002], [0.02, 0.004, 0.0005]])
    with pytest.raises(
        MeshError, match="anchor_radius: the ball of 3 mm around guide 1 .* at most 0.5 mm have"
    ):
        PulledCable.through(beam, guides, PULLED_AT, anchor_radius=0.003)
    PulledCable.through(beam, guides, PULLED_AT, anchor_radius=0.0005)


@pytest.mark.slow
def test_a_point_of_a_curved_element_is_found_inside_it(box) -> None:
    """Mid-edge nodes off their chords: the shape values still reproduce the point."""
    from softfuse.body import QUADRATIC

    mesh = mesh_for(QUADRATIC, box([0.0, 0.01], [0.0, 0.01], [0.0, 0.01]))
    body = Body.from_mesh(mesh, [NeoHookean.from_young(1e5, 0.3)], mesh.nodes[:, 2] == 0.0, element=QUADRATIC)
    bent = body.rest + 1e-3 * jnp.sin(300 * body.rest[:, [1, 2, 0]])
    curved = body.with_rest(bent)
    point = np.array([[0.004, 0.006, 0.0055]])
    held = MaterialPoints.embedded(curved, point)
    np.testing.assert_allclose(
        jnp.einsum("ga,gai->gi", held.shape(bent), bent[held.nodes]), point, atol=1e-15
    )


@pytest.mark.slow
def test_gradients_are_the_differences_of_full_solves(beam, pulled) -> None:
    """Tip and tension in guide positions, stiffness and shortening."""
    newton = Newton(Dense.plan(beam), step_tolerance=1e-12)
    tip = int(np.argmax(np.asarray(beam.rest) @ [1, 1, 1]))

    def read(theta):
        guides, scale, drive = theta
        law = beam.materials[0]
        body = beam.with_materials([NeoHookean(scale * law.mu, scale * law.lame)])
        cable = eqx.tree_at(lambda c: c.ports.points.location, pulled, guides)
        loads = Loads((ShortenedCable.of(cable, body),))
        state = solve(newton, body, loads, drive, State.rest(body, loads)).state
        return jnp.append(body.displacement(state.z)[tip], state.internal)

    at = (jnp.asarray(GUIDES), jnp.array(1.0), jnp.array([0.003]))
    random = np.random.default_rng(0)
    directions = [
        (jnp.asarray(1e-3 * random.normal(size=GUIDES.shape)), jnp.array(0.0), jnp.zeros(1)),
        (jnp.zeros(GUIDES.shape), jnp.array(0.5), jnp.zeros(1)),
        (jnp.zeros(GUIDES.shape), jnp.array(0.0), jnp.array([1e-3])),
    ]
    solved = jax.jit(read)
    slope = jax.jit(lambda d: jax.jvp(read, (at,), (d,))[1])
    pull = jax.jit(lambda w: jax.vjp(read, at)[1](w)[0])
    h = 1e-3
    for d in directions:
        ends = [solved(jax.tree.map(lambda a, b, s=s: a + s * h * b, at, d)) for s in (1, -1)]
        forward = slope(d)
        scale = np.abs(forward).max(initial=1e-12)
        np.testing.assert_allclose(forward, (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-6 * scale)
        weights = jnp.asarray(random.normal(size=4))
        backward = sum(float(jnp.vdot(a, b)) for a, b in zip(pull(weights), d, strict=True))
        np.testing.assert_allclose(backward, float(weights @ forward), rtol=1e-9)


@pytest.mark.parametrize("kind", ["pulled", "shortened"])
def test_laws_near_a_state_are_those_to_first_order(kind: str, pulled, shortened) -> None:
    load = {"pulled": pulled, "shortened": shortened}[kind]
    load = eqx.tree_at(lambda each: each.friction, load, jnp.array(0.2))
    rng = np.random.default_rng(5)
    near = jnp.asarray(GUIDES + 1e-3 * rng.normal(size=GUIDES.shape)).ravel()
    force, moved = jnp.asarray(rng.normal(size=12)), jnp.asarray(rng.normal(size=12))
    tension, drive = (
        (jnp.array([2.0]), jnp.array([0.004])) if kind == "shortened" else (jnp.zeros(0), jnp.ones(1))
    )

    def off(size: float) -> float:
        """How far both are apart when guides have moved, and tension has grown, by so much [m, N / mm]."""
        y, grown = near + size * moved, tension + 1e3 * size
        law = load.equations(force, grown, y, drive)
        return float(jnp.abs(load.equations_near(force, grown, y, drive, (tension, near)) - law).max())

    assert off(0.0) == 0.0
    assert off(1e-4) > 1e-4
    # An error of second order falls to a hundredth.
    assert off(1e-6) == pytest.approx(1e-2 * off(1e-5), rel=0.05)


def test_a_cable_turns_its_beam_by_a_right_angle_in_few_iterations(box) -> None:
    mesh = mesh_for(LINEAR, box(np.linspace(0, 4 * LENGTH, 41), *(2 * [np.linspace(0, SIDE, 3)])))
    body = Body.from_mesh(mesh, [NeoHookean.from_young(YOUNG, 0.3)], mesh.nodes[:, 0] == 0.0, element=LINEAR)
    guides = np.array([[x, 0.006, 0.002] for x in np.linspace(0.004, 0.236, 10)])
    cable = PulledCable.through(body, guides, np.array([-0.01, 0.006, 0.002]), friction=0.1)
    loads = Loads((ShortenedCable.of(cable, body),))
    found = _solve(Newton(Dense.plan(body)), body, loads, jnp.array([0.012]), State.rest(body, loads))
    assert found.result == RESULTS.converged
    x, moved = np.asarray(body.rest)[:, 0], np.asarray(body.rest + body.displacement(found.state.z))
    last, before = (moved[np.isclose(x, at)].mean(axis=0) for at in (4 * LENGTH, 4 * LENGTH - 0.006))
    assert last[2] - before[2] < -3 * abs(last[0] - before[0])
    # It took 214 where each iteration obeyed the law itself on the linearised beam.
    assert int(found.stats.newton_iterations) <= 60
