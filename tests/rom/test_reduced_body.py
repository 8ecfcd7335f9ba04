"""A reduced body against the full one: projections to rounding, equilibria and estimates within a percent."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, TAYLOR_HOOD, AbstractBody, Body, mesh_for
from softfuse.body.stiffness_field import with_field
from softfuse.errors import SoftfuseError, SolveError
from softfuse.estimation.estimator import Estimator
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.functional.chart import FlatChart, facing
from softfuse.functional.embedded_line import EmbeddedLine
from softfuse.functional.point_pressure import PointPressure
from softfuse.material import MooneyRivlin, NeoHookean
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model, compliance, simulate
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.tetmesh import tet_mesh
from softfuse.rom.basis import Basis, RestStiffness, rest_stiffness
from softfuse.rom.cells import Cell
from softfuse.rom.known_inverses import KnownInverses, far_apart
from softfuse.rom.load_paths import LoadPath, load_paths
from softfuse.rom.mode_points import mode_points
from softfuse.rom.projection import project
from softfuse.rom.reduced_body import ReducedBody
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.sampling import Cubature, Sampling, sampled
from softfuse.rom.snapshots import snapshots
from softfuse.rom.teaching import Chart, ChartSettings, teach

MM = 1e-3
NONE = np.zeros((0, 3, 3))
"""Places of patches."""
CELL = Cell(np.array([-12 * MM, 2 * MM]), np.array([4 * MM, 4 * MM]), FlatChart.along((0, 0, -1)))
"""Places of the contact."""
UNSEEN = [((-12.3 * MM, 3.1 * MM), 6.0), ((-9.3 * MM, 0.4 * MM), 7.5), ((-14.9 * MM, 5.2 * MM), 2.2)]
"""Places and forces [N] that nothing was taught on."""


def at(x: float, y: float) -> jax.Array:
    """One place, as a robot wants it."""
    return jnp.asarray(facing(np.array([[x, y, 0.0]]), (0, 0, -1)))


def device_loads(model: Model) -> Callable[[AbstractBody, jax.Array], Loads]:
    """The loads of a robot on any body with its nodes, at places (c, 3, 3)."""
    return lambda body, places: replace(model, body=body).loads(places)


class Taught(NamedTuple):
    """The robot with a reduced body, the chart that it is from, the same body watching all nodes, and its
    states (t, n) at unseen presses.
    """

    model: Model
    chart: Chart
    watching: ReducedBody
    states: np.ndarray


@pytest.fixture(scope="module")
def stiffness(model: Model) -> RestStiffness:
    """Of the full body."""
    assert isinstance(model.body, Body)
    return rest_stiffness(model.body)


@pytest.fixture(scope="module")
def taught(model: Model, stiffness: RestStiffness) -> Taught:
    """The small robot around one place, from four load paths."""
    body = model.body
    assert isinstance(body, Body)
    chart = teach(
        model.linear,
        body,
        stiffness,
        device_loads(model),
        load_paths(CELL.parts(2), 1, np.zeros(1), np.array([8.0]), levels=3, near=6),
        around=[jnp.asarray(place)[None] for place in CELL.grid(9)],
        settings=ChartSettings(displacements=45, pressures=18),
    )
    small = reduced_model(model, stiffness, chart, NONE)
    states = [simulate(small, at(*place), jnp.array([force])).state.z for place, force in UNSEEN]
    watching = project(body, stiffness, chart._replace(watched=np.arange(body.n_nodes)))
    return Taught(small, chart, watching, np.array(states))


@pytest.fixture(scope="module", params=[TAYLOR_HOOD, LINEAR], ids=lambda element: element.name)
def heavy(request: pytest.FixtureRequest) -> Body:
    """Two materials under gravity, elements stiffer or softer than these."""
    geometry = PadGeometry((60 * MM, 40 * MM, 18 * MM), (20 * MM, 20 * MM, 6 * MM), ((0.0, 0.0),), 6 * MM)
    mesh = mesh_for(request.param, pad_mesh(geometry, 40 * MM, 40 * MM))
    right = mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 0] > 0
    mesh = tet_mesh(mesh.nodes, mesh.tets, region=right)
    laws = [NeoHookean.from_young(0.6e6, 0.49), MooneyRivlin(6e4, 2e4, 2e6)]
    fixed = mesh.nodes[:, 2] < 1e-9
    body = Body.from_mesh(
        mesh, laws, fixed, element=request.param, densities=[1080.0, 1200.0], gravity=[1.0, 2.0, -9.81]
    )
    return body.with_factors(jnp.asarray(np.random.default_rng(5).uniform(0.5, 2.0, len(mesh.tets))))


@pytest.mark.slow
@pytest.mark.parametrize("beyond_rest", [True, False])
def test_with_all_points_it_is_the_projection_of_the_full_body(heavy: Body, beyond_rest: bool) -> None:
    random = np.random.default_rng(3)
    u, c = heavy.n_displacements, heavy.n - heavy.n_displacements
    basis = Basis(random.normal(size=(u, 9)), random.normal(size=(c, 4 if c else 0)))
    count = heavy.volumes.size
    every = Cubature(np.arange(count), np.ones(count), 0.0)
    sampling, watched, n = Sampling(every, beyond_rest), np.arange(heavy.n_nodes), basis.columns.shape[1]
    chart = Chart(basis, sampling, watched, np.ones(n), np.zeros((1, n)), 1.0)
    reduced = project(heavy, rest_stiffness(heavy), chart)
    modes = basis.columns
    z = 1e-5 * random.normal(size=reduced.n)
    expected = modes.T @ np.asarray(jax.jit(Body.residual)(heavy, jnp.asarray(modes @ z)))
    found = np.asarray(jax.jit(ReducedBody.residual)(reduced, jnp.asarray(z)))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    stiff = modes.T @ np.asarray(
        jax.jit(lambda b, z, x: b.tangent_action(z)(x))(heavy, jnp.asarray(modes @ z), jnp.asarray(modes))
    )
    tangents = np.asarray(jax.jit(ReducedBody.element_tangents)(reduced, jnp.asarray(z)))[0]
    np.testing.assert_allclose(tangents, stiff, rtol=1e-8, atol=1e-9 * np.abs(stiff).max())
    np.testing.assert_allclose(
        reduced.displacement(jnp.asarray(z)), heavy.displacement(jnp.asarray(modes @ z)), atol=1e-15
    )
    ratios = jax.jit(Body.volume_ratios)(heavy, jnp.asarray(modes @ z))
    found = np.ravel(reduced.volume_ratios(jnp.asarray(z)))
    np.testing.assert_allclose(np.sort(found), np.sort(np.ravel(ratios)), rtol=1e-12)
    assert float(reduced.volume) == pytest.approx(float(heavy.volume))
    place = np.array([22 * MM, 4 * MM, 9 * MM])
    line = EmbeddedLine.of(heavy, MM * np.array([[-25.0, -12.0, 2.0], [25.0, 12.0, 4.0]]))
    for functional in (PointPressure.of(heavy, place, 2 * MM), line):
        change = jax.jit(type(functional).change)
        np.testing.assert_allclose(
            change(functional, reduced, jnp.asarray(z)),
            change(functional, heavy, jnp.asarray(modes @ z)),
            rtol=1e-9,
        )
    whole = heavy.weight_resultant(jnp.asarray(modes @ z))
    np.testing.assert_allclose(reduced.weight_resultant(jnp.asarray(z)), whole, rtol=1e-10)


def test_its_tangent_is_the_slope_of_its_residual(taught: Taught) -> None:
    body = taught.model.body
    z = jnp.asarray(taught.states[0])
    slope = jax.jit(jax.jacfwd(ReducedBody.residual, argnums=1))(body, z)
    tangent = jax.jit(ReducedBody.element_tangents)(body, z)[0]
    np.testing.assert_allclose(tangent, slope, atol=1e-9 * float(jnp.abs(slope).max()))
    np.testing.assert_allclose(slope, slope.T, atol=1e-9 * float(jnp.abs(slope).max()))


def test_its_tangent_acts_on_directions_without_being_made(taught: Taught) -> None:
    body, z = taught.model.body, jnp.asarray(taught.states[1])
    whole = jax.jit(ReducedBody.element_tangents)(body, z)[0]
    directions = jnp.asarray(np.random.default_rng(1).normal(size=(body.n, 3)))
    acted = jax.jit(lambda b, z, x: b.tangent_action(z)(x))(body, z, directions)
    np.testing.assert_allclose(acted, whole @ directions, atol=1e-9 * float(jnp.abs(acted).max()))


def test_single_precision_moves_forces_by_a_hundred_thousandth(taught: Taught) -> None:
    body, z = taught.model.body, jnp.asarray(taught.states[1])
    for of in (ReducedBody.residual, ReducedBody.displacement):
        exact, rough = (np.asarray(jax.jit(of)(each, z)) for each in (body, body.rough()))
        np.testing.assert_allclose(rough, exact, atol=1e-5 * np.abs(exact).max())


def test_the_inverse_nearest_to_a_state_is_known_well_enough_to_converge_with(taught: Taught) -> None:
    body, known = taught.model.body, taught.model.linear.rough()
    rest, own = jnp.zeros(body.n), jnp.zeros((body.n, body.n))
    for state in (*taught.chart.typical[[0, -1]], *taught.states):
        inverse = known.near(known.inverses[0], rest, jnp.asarray(state))
        off = np.eye(body.n) - np.asarray(inverse) @ np.asarray(body.element_tangents(jnp.asarray(state))[0])
        contraction = np.abs(np.linalg.eigvals(off)).max()
        assert contraction < (1e-4 if state in taught.chart.typical else 0.5)
    state = jnp.asarray(taught.states[0])
    np.testing.assert_array_equal(known.near(own, state, state), own)
    np.testing.assert_array_equal(known.near(own, state, rest), known.inverses[0])


@pytest.mark.slow
def test_an_inverse_is_made_where_none_is_known_that_converges(model, taught) -> None:
    (place, force), limits = UNSEEN[1], Limits(jnp.zeros(1), jnp.array([12.0]), jnp.array([1e-6]))
    linear = taught.model.linear
    too_stiff = KnownInverses(linear.known.states[:1], 0.4 * linear.known.inverses[:1])
    found = {}
    for name, known in (("all", linear.known), ("too stiff", too_stiff)):
        small = replace(taught.model, linear=replace(linear, known=known))
        estimator = Estimator(small, limits, at(*place))
        renewed = 0
        for part in np.linspace(0.02, 1.0, 50):
            reading = model.reading(simulate(model, at(*place), jnp.array([part * force])).state)
            told = estimator.update(Observation(reading, 1e9 * jnp.eye(model.n_readings), at(*place)))
            renewed += told.renewed
        found[name] = told.drive[0], renewed
    assert found["all"][1] == 0 < found["too stiff"][1] < 15
    for drive, _ in found.values():
        assert drive == pytest.approx(force, rel=1e-2)


def test_typical_states_are_far_from_each_other_and_rest() -> None:
    states = np.array([[0.1], [4.0], [4.1], [-3.0], [0.9]])
    assert far_apart(states, 4)[:, 0].tolist() == [0.0, 4.1, -3.0, 0.9]
    assert set(far_apart(states, 9)[:, 0].tolist()) == {0.0, *states[:, 0].tolist()}


def test_projected_volumes_are_those_of_the_cavities(model, taught) -> None:
    body, cavities = taught.watching, [reading.functional for reading in model.readings]
    (projected,) = (reading.functional for reading in taught.model.readings)
    assert projected.count == len(cavities) > 1

    def exact(z):
        return jnp.stack([cavity.change(body, z) for cavity in cavities])

    def found(z):
        return projected.change(body, z)

    volumes, slopes = (
        jax.jit(lambda z: (exact(z), found(z))),
        jax.jit(lambda z: (jax.jacrev(exact)(z), jax.jacrev(found)(z))),
    )
    for z in jnp.asarray(taught.states):
        expected, seen = volumes(z)
        np.testing.assert_allclose(seen, expected, rtol=1e-3, atol=1e-3 * float(jnp.abs(expected).max()))
        # Along what states differ by: directions of the walls that none of them uses are left out.
        along = taught.states - np.asarray(z)
        expected, seen = (np.asarray(slope) @ along.T for slope in slopes(z))
        for cavity, (one, other) in enumerate(zip(seen, expected, strict=True)):
            np.testing.assert_allclose(one, other, atol=1e-3 * np.abs(other).max(), err_msg=f"{cavity}")


def test_modes_are_orthonormal_in_stiffness_and_compressibility(taught, stiffness) -> None:
    for modes, matrix in zip(taught.chart.basis, (stiffness.displacement, stiffness.pressure), strict=True):
        np.testing.assert_allclose(modes.T @ (matrix @ modes), np.eye(modes.shape[1]), atol=1e-9)


@pytest.mark.parametrize(("place", "force"), UNSEEN)
def test_unseen_presses_are_within_a_percent_of_the_full_body(model, taught, place, force) -> None:
    exact = simulate(model, at(*place), jnp.array([force]))
    found = simulate(taught.model, at(*place), jnp.array([force]))
    shape = model.body.displacement(exact.state.z)
    missed = taught.model.body.displacement(found.state.z) - shape
    assert float(jnp.max(jnp.abs(missed))) < 1e-2 * float(jnp.max(jnp.abs(shape)))
    volumes = model.reading(exact.state)
    assert float(jnp.max(jnp.abs(taught.model.reading(found.state) - volumes))) < 1e-2 * float(
        jnp.max(jnp.abs(volumes))
    )
    assert taught.model.body.n < 0.03 * model.body.n
    assert len(taught.chart.sampling.cubature.parts) < 0.1 * model.body.volumes.size


@pytest.mark.slow
def test_a_stiffness_field_is_reduced_with_the_body(model: Model) -> None:
    """Against the full body, and by far more than it misses of that."""
    assert isinstance(model.body, Body)
    body = with_field(model.body, jnp.array([0.3, -0.1, 0.2, 0.1, 0.1, 0.0, 0.2, 0.0, 0.1]))
    made = replace(model, body=body, linear=Multifrontal.plan(body))
    stiffness = rest_stiffness(body)
    chart = teach(
        made.linear,
        body,
        stiffness,
        device_loads(made),
        load_paths(CELL.parts(2), 1, np.zeros(1), np.array([8.0]), levels=3, near=6),
        around=[jnp.asarray(place)[None] for place in CELL.grid(9)],
        settings=ChartSettings(displacements=45, pressures=18),
    )
    small = reduced_model(made, stiffness, chart, NONE)
    place, force = UNSEEN[0]
    plain, exact, found = (
        np.asarray(each.reading(simulate(each, at(*place), jnp.array([force])).state))
        for each in (model, made, small)
    )
    assert np.abs(found - exact).max() < 1e-2 * np.abs(exact).max() < 0.1 * np.abs(plain - exact).max()


@pytest.mark.slow
def test_its_compliance_is_that_of_the_full_body_and_the_slope_of_its_own_readings(model, taught) -> None:
    (place, force), h = UNSEEN[0], 1e-4
    drive = jnp.array([force])
    own = compliance(taught.model, at(*place), drive)
    exact = compliance(model, at(*place), drive)
    np.testing.assert_allclose(own, exact, atol=2e-2 * float(jnp.max(jnp.abs(exact))))
    above, below = (
        taught.model.reading(simulate(taught.model, at(*place), drive + d).state) for d in (h, -h)
    )
    np.testing.assert_allclose(own[:, 0], (above - below) / (2 * h), rtol=1e-4, atol=1e-12)


@pytest.mark.slow
def test_the_estimator_finds_forces_with_it_unchanged(model, taught) -> None:
    (place, force), limits = UNSEEN[1], Limits(jnp.zeros(1), jnp.array([12.0]), jnp.array([1e-6]))
    reading = model.reading(simulate(model, at(*place), jnp.array([force])).state)
    estimator = Estimator(taught.model, limits, at(*place))
    seen = Observation(reading, 1e9 * jnp.eye(model.n_readings), at(*place))
    for _ in range(8):
        found = estimator.update(seen)
    assert found.drive[0] == pytest.approx(force, rel=1e-2)
    assert float(found.report.unbalanced) < 1e-3


def test_forces_on_nodes_that_nothing_watches_are_not_lost_without_a_word(model, taught, stiffness) -> None:
    body = model.body
    top = np.unique(np.asarray(model.contacts[0].surface.faces))
    reduced = project(body, stiffness, taught.chart._replace(watched=top))
    below = np.setdiff1d(np.arange(body.n_nodes), top)[:2]
    z = jnp.asarray(taught.states[0])
    moved = np.asarray(reduced.watched(z))
    np.testing.assert_allclose(moved[top], np.asarray(reduced.displacement(z))[top], atol=1e-18)
    assert np.isnan(moved[below]).all()
    force = jnp.ones((2, 3, 1))
    assert np.isfinite(reduced.spread(jnp.asarray(top[:2]), force)).all()
    assert np.isnan(reduced.spread(jnp.asarray(below), force)).any()


def test_spreading_forces_is_the_transpose_of_watching(taught: Taught) -> None:
    body, random = taught.watching, np.random.default_rng(2)
    nodes = jnp.asarray(random.integers(0, body.n_nodes, (5, 4)))
    forces, z = jnp.asarray(random.normal(size=(5, 4, 3, 1))), jnp.asarray(random.normal(size=body.n))
    work = jnp.sum(forces[..., 0] * body.watched(z)[nodes])
    np.testing.assert_allclose(body.spread(nodes, forces)[:, 0] @ z, work, rtol=1e-9)


@pytest.mark.slow
def test_spreading_along_a_direction_is_spreading_column_by_column(model, taught) -> None:
    random = np.random.default_rng(4)
    nodes = jnp.asarray(random.integers(0, model.body.n_nodes, (7, 4)))
    forces, column = jnp.asarray(random.normal(size=(7, 4))), jnp.array([0, 2, 1, 2, 0, 1, 2])
    direction = jnp.array([0.6, -0.3, 0.7])
    for body in (model.body, taught.watching):
        along = body.spread_along(direction, nodes, forces, column, 3)
        for k in range(3):
            each = forces[column == k][:, :, None, None] * direction[:, None]
            own = body.spread(nodes[column == k], each)[:, 0]
            np.testing.assert_allclose(along[:, k], own, atol=1e-12 * float(jnp.abs(own).max()))


@pytest.mark.slow
def test_snapshots_end_where_the_body_cannot_carry_the_load(model) -> None:
    levels, place = np.array([[3.0], [4000.0], [5.0]]), at(-12 * MM, 3 * MM)
    path = LoadPath(place, levels, jnp.tile(place, (3, 1, 1, 1, 1)), np.array([[[3.02]], [[4.0]], [[5.0]]]))
    found = snapshots(model.linear, model.body, device_loads(model), [path])
    assert found.found.tolist() == [[[True, True], [False, False], [False, False]]]
    assert found.found[:, :, 0].sum() == 1
    at_level, near = (simulate(model, place, jnp.array([force])).state.z for force in (3.0, 3.02))
    moved = model.body.motion
    np.testing.assert_allclose(moved(found.states[0]), moved(at_level), atol=1e-9)
    # One step with a factor that is a little older.
    apart = float(jnp.max(jnp.abs(moved(near - at_level))))
    np.testing.assert_allclose(moved(found.states[1]), moved(near), atol=0.15 * apart)


def test_a_state_at_rest_is_refused(model, taught) -> None:
    still = np.append(taught.states, np.zeros((1, taught.states.shape[1])), axis=0)
    with pytest.raises(SolveError, match="training state 3 is the body at rest"):
        sampled(
            mode_points(model.body, taught.chart.basis),
            still[None],
            np.ones((1, len(still)), bool),
            tolerance=1e-2,
            most=10,
        )


def test_a_reduced_device_is_not_reduced_again(taught, stiffness) -> None:
    with pytest.raises(SoftfuseError, match="the body is a reduced one"):
        reduced_model(taught.model, stiffness, taught.chart, NONE)
