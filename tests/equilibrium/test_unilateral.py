"""Cell forces under rigid discs: the optimality conditions, and the same answer as an exact QP solver.

0 ≤ a ⊥ g − d ≥ 0 with g = g₀ + S a and Σ a = F for each disc, which is the minimum of ½ aᵀS a + g₀ᵀa over
a ≥ 0, Σ a = F.
"""

from ctypes import c_int

import daqp
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.equilibrium.unilateral import distribute, distribute_on

_distribute, _distribute_on = jax.jit(distribute), jax.jit(distribute_on)
SHAPES = [(1, 1), (1, 9), (2, 6)]


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


def _check_optimality(compliance, offset, total, force, depth, pressed) -> None:
    force, depth, pressed = (np.asarray(v) for v in (force, depth, pressed))
    gap = offset + np.einsum("cmdn,dn->cm", compliance, force) - depth[:, None]
    length = np.abs(offset).max() + np.abs(compliance).max() * np.abs(total).max()
    np.testing.assert_allclose(force.sum(axis=1), total, rtol=1e-12)
    assert force.min() >= 0
    assert gap.min() >= -1e-12 * length
    np.testing.assert_array_equal(force[~pressed], 0.0)
    np.testing.assert_allclose(gap[pressed], 0.0, rtol=0, atol=1e-12 * length)


@pytest.mark.parametrize("kind", [_compliance, _any_compliance])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), tilt=st.floats(0.0, 20.0), start=st.integers(0, 3))
def test_optimal_and_equal_to_a_qp_solver_from_any_start(shape, kind, seed, tilt, start) -> None:
    compliance, offset, total = _problem(seed, *shape, tilt, kind)
    first = [np.ones(shape), np.zeros(shape), np.eye(*shape), np.eye(*shape)[:, ::-1]][start].astype(bool)
    force, depth, pressed = _distribute(first, compliance, offset, total)
    _check_optimality(compliance, offset, total, force, depth, pressed)
    np.testing.assert_allclose(
        force, _reference(compliance, offset, total), atol=1e-9 * total.max(), rtol=1e-9
    )


def test_cases_that_lift_some_cells_and_press_others() -> None:
    """The problems above are no formality: the set of pressed cells is neither all nor one."""
    counts = []
    for seed in range(10):
        compliance, offset, total = _problem(seed, 2, 6)
        counts.append(int(_distribute(np.ones((2, 6), bool), compliance, offset, total)[2].sum()))
    assert 2 < np.mean(counts) < 12 and len(set(counts)) > 2


def test_two_discs_feel_each_other() -> None:
    compliance, offset, total = _problem(1, 2, 6, tilt=0.1)
    apart = compliance * np.eye(2)[:, None, :, None]
    start = np.ones((2, 6), bool)
    together, alone = (_distribute(start, s, offset, total) for s in (compliance, apart))
    single = _distribute(start[:1], compliance[:1, :, :1], offset[:1], total[:1])
    np.testing.assert_allclose(alone[0][0], single[0][0], rtol=1e-10)
    assert np.all(np.asarray(together[1]) > np.asarray(alone[1]))  # each disc sinks into the other's dent


def test_a_disc_without_force_rests_on_the_highest_cells() -> None:
    compliance, offset, _ = _problem(2, 2, 6)
    force, depth, pressed = _distribute(np.ones((2, 6), bool), compliance, offset, np.zeros(2))
    np.testing.assert_allclose(force, 0.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(depth, offset.min(axis=1), rtol=1e-6)
    np.testing.assert_array_equal(pressed.sum(axis=1), 1)
    np.testing.assert_array_equal(np.argmax(pressed, axis=1), offset.argmin(axis=1))


def test_cells_that_no_mesh_tells_apart_share_their_force() -> None:
    """Each cell twice: S is singular, the pair's force is that of the single cell, halved."""
    compliance, offset, total = _problem(4, 1, 6, tilt=0.1)
    once, depth, pressed = _distribute(np.ones((1, 6), bool), compliance, offset, total)
    assert 1 < int(pressed.sum()) < 6
    twice = np.repeat(np.repeat(compliance, 2, axis=1), 2, axis=3)
    force, same_depth, _ = _distribute(np.ones((1, 12), bool), twice, np.repeat(offset, 2, axis=1), total)
    np.testing.assert_allclose(force, np.repeat(once, 2, axis=1) / 2, rtol=0, atol=1e-6 * total[0])
    np.testing.assert_allclose(same_depth, depth, rtol=1e-8)


def test_one_cell_carries_everything() -> None:
    force, depth, pressed = _distribute(
        np.ones((1, 1), bool), np.full((1, 1, 1, 1), 2e-3), np.full((1, 1), 1e-3), np.array([3.0])
    )
    np.testing.assert_allclose([force[0, 0], depth[0]], [3.0, 7e-3], rtol=1e-14)
    assert pressed.all()


@pytest.mark.parametrize("shape", SHAPES[1:], ids=str)
def test_derivative_on_the_pressed_cells_is_that_of_the_whole(shape) -> None:
    """jvp of `distribute_on` against differences of full solves, and its vjp against the jvp."""
    random = np.random.default_rng(7)
    start = np.ones(shape, bool)
    arguments = _problem(3, *shape)
    pressed = _distribute(start, *arguments)[2]
    wobble = random.normal(size=(shape[0] * shape[1],) * 2)
    direction = (
        1e-4 * (wobble @ wobble.T).reshape(*shape, *shape),
        1e-3 * random.normal(size=shape),
        random.normal(size=shape[0]),
    )
    _, slope = jax.jvp(lambda *a: _distribute_on(pressed, *a), arguments, direction)
    h = 1e-6

    def moved(step):
        force, depth, on = _distribute(
            start, *(a + step * d for a, d in zip(arguments, direction, strict=True))
        )
        np.testing.assert_array_equal(on, pressed)
        return force, depth

    for exact, ahead, behind in zip(slope, moved(h), moved(-h), strict=True):
        difference = (ahead - behind) / (2 * h)
        np.testing.assert_allclose(exact, difference, rtol=0, atol=1e-7 * float(jnp.abs(exact).max()))
    cotangent = (random.normal(size=shape), random.normal(size=shape[0]))
    _, pull = jax.vjp(lambda *a: _distribute_on(pressed, *a), *arguments)
    forward = sum(float(np.sum(a * b)) for a, b in zip(cotangent, slope, strict=True))
    backward = sum(float(np.sum(a * b)) for a, b in zip(pull(cotangent), direction, strict=True))
    np.testing.assert_allclose(forward, backward, rtol=1e-10)


def test_batch_of_problems_is_each_alone() -> None:
    """vmap: the searches of different lengths stop each at its own end."""
    problems = [_problem(seed, 1, 9) for seed in range(6)]
    start = np.ones((1, 9), bool)
    batch = jax.jit(jax.vmap(lambda s, g, f: distribute(start, s, g, f)))(
        *(np.stack(part) for part in zip(*problems, strict=True))
    )
    for k, problem in enumerate(problems):
        for together, alone in zip(batch, _distribute(start, *problem), strict=True):
            np.testing.assert_allclose(together[k], alone, rtol=1e-9, atol=1e-15)
