"""Cell forces under rigid discs: the optimality conditions, and the same answer as an exact QP solver.

0 ≤ a ⊥ g − d ≥ 0 with g = g₀ + S a and Σ a = F for each disc, which is the minimum of ½ aᵀS a + g₀ᵀa over a ≥
0, Σ a = F.
"""

from ctypes import c_int
from typing import NamedTuple

import daqp
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.functional.chart import facing
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.mechanics import LinearPorts, Loads, Punch
from softfuse.mechanics.held_loads import HeldLoads
from softfuse.mechanics.interface import settle
from softfuse.mechanics.model import simulate

SHAPES = [(1, 1), (1, 9), (2, 6)]
GAMMA = 1e3  # N/m
WEIGHT = 1e-9  # N, what a disc weighs


class Found(NamedTuple):
    force: np.ndarray
    depth: np.ndarray
    found: bool


def _discs(layers) -> HeldLoads:
    """Discs with layers (c, m) m/N under their cells; of the body only its compliance matters here."""
    m = layers.shape[1]
    ports = LinearPorts(jnp.zeros(m), jnp.zeros((1, m)))
    loads = Loads(tuple(Punch(ports, jnp.asarray(layer), jnp.asarray(GAMMA)) for layer in layers))
    return HeldLoads(loads, jnp.zeros(layers.size))


@eqx.filter_jit
def _settled(compliance, offset, total, start, layers=None):
    c, m = offset.shape
    layers = jnp.zeros((c, m)) if layers is None else layers
    loads, s = _discs(layers), jnp.reshape(compliance, (c * m, c * m))
    return settle(loads, jnp.ravel(offset), s, jnp.asarray(total), (jnp.ravel(start), jnp.zeros(c)))


def distributed(compliance, offset, total, start=None, layers=None) -> Found:
    start = np.zeros(offset.shape) if start is None else start
    found = _settled(compliance, offset, total, start, layers)
    return Found(np.asarray(found.force).reshape(offset.shape), np.asarray(found.internal), bool(found.found))


def _any_compliance(random, c: int, m: int) -> np.ndarray:
    """S (c, m, c, m) m/N: any positive definite matrix, whose cells may also lift each other."""
    noise = random.normal(size=(c * m, c * m))
    return 1e-3 * (noise @ noise.T / (c * m) + 0.1 * np.eye(c * m)).reshape(c, m, c, m)


def _compliance(random, c: int, m: int) -> np.ndarray:
    """S (c, m, c, m) m/N: cells that sink into each other's dents, softened at random: no two are alike."""
    place = random.uniform(-1, 1, (c * m, 2)) * 5e-3
    apart = np.linalg.norm(place[:, None] - place[None], axis=-1)
    noise = random.normal(size=(c * m, c * m))
    return (1e-3 * np.exp(-apart / 4e-3) + 1e-4 * noise @ noise.T / (c * m)).reshape(c, m, c, m)


def _problem(seed: int, c: int, m: int, tilt: float = 1.0, compliance=_compliance):
    random = np.random.default_rng(seed)
    offset = tilt * random.normal(size=(c, m)) * 1e-3
    return compliance(random, c, m), offset, random.uniform(0.1, 5.0, c)


def _reference(compliance, offset, total) -> np.ndarray:
    """The same problem by daqp, in units that make its tolerances relative."""
    c, m = offset.shape
    scale = np.trace(compliance.reshape(c * m, c * m)) / (c * m)
    belongs = np.kron(np.eye(c), np.ones(m))
    a, _, flag, _ = daqp.solve(
        np.ascontiguousarray(compliance.reshape(c * m, c * m) / scale),
        np.ascontiguousarray(offset.ravel() / scale),
        np.ascontiguousarray(belongs),
        np.concatenate([np.full(c * m, 1e30), total]),
        np.concatenate([np.zeros(c * m), total]),
        np.array([0] * (c * m) + [5] * c, dtype=c_int),
        primal_tol=1e-12,
        dual_tol=1e-12,
    )
    assert flag == 1
    return a.reshape(c, m)


def _check_optimality(compliance, offset, total, found: Found) -> None:
    force, depth, _ = found
    gap = offset + np.einsum("cmdn,dn->cm", compliance, force) - depth[:, None]
    length = np.abs(offset).max() + np.abs(compliance).max() * np.abs(total).max()
    tiny = 1e-9 * length
    assert found.found
    np.testing.assert_allclose(force.sum(axis=1), total + WEIGHT, rtol=1e-10)
    assert force.min() >= -1e-12 and gap.min() >= -tiny
    np.testing.assert_allclose(np.minimum(force / total.max(), gap / length), 0.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", [_compliance, _any_compliance])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@settings(max_examples=40, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), tilt=st.floats(0.0, 20.0), start=st.integers(0, 3))
def test_optimal_and_equal_to_a_qp_solver_from_any_start(shape, kind, seed, tilt, start) -> None:
    compliance, offset, total = _problem(seed, *shape, tilt, kind)
    first = [np.ones(shape), -np.ones(shape), np.eye(*shape), -np.eye(*shape)[:, ::-1]][start]
    found = distributed(compliance, offset, total, first)
    _check_optimality(compliance, offset, total, found)
    expected = _reference(compliance, offset, total)
    np.testing.assert_allclose(found.force, expected, atol=1e-7 * total.max(), rtol=1e-7)


def test_cases_that_lift_some_cells_and_press_others() -> None:
    """The problems above are no formality: the set of pressed cells is neither all nor one."""
    counts = [int((distributed(*_problem(seed, 2, 6)).force > 0).sum()) for seed in range(10)]
    assert 2 < np.mean(counts) < 12 and len(set(counts)) > 2


def test_two_discs_feel_each_other() -> None:
    compliance, offset, total = _problem(1, 2, 6, tilt=0.1)
    apart = compliance * np.eye(2)[:, None, :, None]
    together, alone = (distributed(s, offset, total) for s in (compliance, apart))
    single = distributed(compliance[:1, :, :1], offset[:1], total[:1])
    np.testing.assert_allclose(alone.force[0], single.force[0], rtol=1e-8, atol=1e-9)
    assert np.all(together.depth > alone.depth)  # each disc sinks into the other's dent


@pytest.mark.parametrize("seed", range(10))
def test_a_layer_is_compliance_that_each_cell_has_for_itself(seed: int) -> None:
    compliance, offset, total = _problem(seed, 2, 6)
    layers = np.random.default_rng(seed).uniform(0.0, 2e-3, (2, 6))
    found = distributed(compliance, offset, total, layers=layers)
    both = compliance + np.diag(layers.ravel()).reshape(2, 6, 2, 6)
    _check_optimality(both, offset, total, found)
    expected = distributed(both, offset, total)
    np.testing.assert_allclose(found.force, expected.force, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-8)


def test_under_a_layer_much_softer_than_the_body_pressure_is_uniform(model) -> None:
    soft = 1e4 * 8e-3 / float(model.body.pressure_unit)
    padded = eqx.tree_at(lambda d: d.contacts[0].compliance, model, jnp.asarray(soft))
    place, force = facing(np.array([[0.004, 0.002, 0.018]]), (0, 0, -1)), jnp.array([2.0])
    state = simulate(padded, place, force).state
    areas = 8e-3**2 * np.asarray(padded.contacts[0].cells.area)
    np.testing.assert_allclose(areas.sum(), np.pi * 8e-3**2, rtol=1e-12)
    np.testing.assert_allclose(state.force, 2.0 * areas / areas.sum(), rtol=1e-3)
    np.testing.assert_allclose(state.internal[0], soft * 2.0 / areas.sum(), rtol=1e-3)


def test_a_disc_without_force_rests_on_the_highest_cells() -> None:
    compliance, offset, _ = _problem(2, 2, 6)
    found = distributed(compliance, offset, np.zeros(2))
    np.testing.assert_allclose(found.force, 0.0, rtol=0, atol=2 * WEIGHT)
    np.testing.assert_allclose(found.depth, offset.min(axis=1), rtol=1e-6)
    np.testing.assert_array_equal(np.argmax(found.force, axis=1), offset.argmin(axis=1))


def test_cells_that_no_mesh_tells_apart_share_their_force() -> None:
    """Each cell twice: S is singular, the pair's force is that of the single cell, halved."""
    compliance, offset, total = _problem(4, 1, 6, tilt=0.1)
    once = distributed(compliance, offset, total)
    assert 1 < int((once.force > 0).sum()) < 6
    twice = np.repeat(np.repeat(compliance, 2, axis=1), 2, axis=3)
    found = distributed(twice, np.repeat(offset, 2, axis=1), total)
    np.testing.assert_allclose(
        found.force, np.repeat(once.force, 2, axis=1) / 2, rtol=0, atol=1e-5 * total[0]
    )
    np.testing.assert_allclose(found.depth, once.depth, rtol=1e-8)


@pytest.mark.parametrize("seed", range(20))
def test_cells_that_a_coarse_mesh_ties_to_each_other_find_their_forces(seed: int) -> None:
    """36 cells of a disc of 10 mm on quadratic triangles of 20 mm: what some fifteen nodes move is all that
    these cells can do.
    """
    at = np.stack([*np.mgrid[0:9, 0:9].reshape(2, -1), np.zeros(81)], axis=1)  # in cm
    first = np.array([9 * x + y for x in range(0, 7, 2) for y in range(0, 7, 2)])[:, None]
    faces = np.concatenate([first + [0, 18, 2, 9, 10, 1], first + [20, 2, 18, 11, 10, 19]])
    surface, cells = ContactSurface.pressed(faces, np.array([0.0, 0.0, -1.0])), flat_punch()
    middle = np.append(np.random.default_rng(seed).uniform(2.0, 6.0, 2), 0.0)
    disc = Contact(surface, cells, jnp.asarray(middle), jnp.asarray(1.0))
    on = surface.land(jnp.asarray(at), disc.points)
    carried = np.zeros((cells.count, len(at)))
    np.add.at(carried, (np.asarray(cells.cell)[:, None], np.asarray(on.nodes)), np.asarray(disc.parts(on)))
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    compliance = carried @ (1e-3 * np.exp(-apart / 0.8)) @ carried.T
    assert np.linalg.matrix_rank(compliance) < cells.count
    compliance, offset, total = compliance.reshape(1, 36, 1, 36), np.zeros((1, 36)), np.array([5.0])
    _check_optimality(compliance, offset, total, distributed(compliance, offset, total))


def test_one_cell_carries_everything() -> None:
    found = distributed(np.full((1, 1, 1, 1), 2e-3), np.full((1, 1), 1e-3), np.array([3.0]))
    np.testing.assert_allclose([found.force[0, 0], found.depth[0]], [3.0, 7e-3], rtol=1e-8)


@pytest.mark.parametrize("shape", SHAPES[1:], ids=str)
def test_derivatives_are_differences_and_transpose(shape) -> None:
    random = np.random.default_rng(7)
    arguments = tuple(map(jnp.asarray, _problem(3, *shape)))
    pressed = distributed(*map(np.asarray, arguments)).force > 0
    wobble = random.normal(size=(shape[0] * shape[1],) * 2)
    direction = (
        jnp.asarray(1e-4 * (wobble @ wobble.T).reshape(*shape, *shape)),
        jnp.asarray(1e-3 * random.normal(size=shape)),
        jnp.asarray(random.normal(size=shape[0])),
    )

    def solved(*args):
        found = _settled(*args, jnp.zeros(shape))
        return found.force, found.internal

    _, slope = jax.jvp(solved, arguments, direction)
    h = 1e-6

    def moved(step):
        force, depth = solved(*(a + step * d for a, d in zip(arguments, direction, strict=True)))
        np.testing.assert_array_equal(np.asarray(force).reshape(shape) > 0, pressed)
        return force, depth

    for exact, ahead, behind in zip(slope, moved(h), moved(-h), strict=True):
        difference = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(exact, difference, rtol=0, atol=1e-6 * float(jnp.abs(exact).max()))

    def slope_at(*args):
        return jax.jvp(solved, args, direction)[1]

    _, bend = jax.jvp(slope_at, arguments, direction)
    ahead, behind = (
        slope_at(*(a + step * d for a, d in zip(arguments, direction, strict=True))) for step in (h, -h)
    )
    for exact, after, before in zip(bend, ahead, behind, strict=True):
        np.testing.assert_allclose(
            exact, (after - before) / (2 * h), rtol=0, atol=1e-5 * float(jnp.abs(exact).max())
        )
    cotangent = tuple(jnp.asarray(random.normal(size=part.shape)) for part in slope)
    _, pull = jax.vjp(solved, *arguments)
    forward = sum(float(jnp.vdot(a, b)) for a, b in zip(cotangent, slope, strict=True))
    backward = sum(float(jnp.vdot(a, b)) for a, b in zip(pull(cotangent), direction, strict=True))
    np.testing.assert_allclose(forward, backward, rtol=1e-10)


def test_batch_of_problems_is_each_alone() -> None:
    """vmap: the searches of different lengths stop each at its own end."""
    problems = [_problem(seed, 1, 9) for seed in range(6)]
    batch = jax.vmap(_settled)(*(np.stack(part) for part in zip(*problems, strict=True)), np.zeros((6, 1, 9)))
    for k, problem in enumerate(problems):
        alone = distributed(*problem)
        np.testing.assert_allclose(np.asarray(batch.force)[k], alone.force[0], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(np.asarray(batch.internal)[k], alone.depth, rtol=1e-8)
