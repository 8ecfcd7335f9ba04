"""The bounded QP against daqp, an exact active-set solver, and its derivative against differences."""

import daqp
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation import bounded_qp
from softfuse.estimation.bounded_qp import Rows, kkt_residual, solve_bounded_qp


def _problem(seed: int, n: int):
    """Scales as in estimates: compliances that differ by orders of magnitude between contacts."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(n + 2, n)) * 10.0 ** rng.uniform(-2, 2, n)
    q = w.T @ w
    b = w.T @ rng.normal(size=n + 2) * 10
    lower = -rng.uniform(0, 3, n)
    return q, b, lower, lower + rng.uniform(0.1, 5, n)


@pytest.mark.parametrize("n", [1, 2, 4, 8])
@pytest.mark.parametrize("seed", range(6))
def test_it_agrees_with_daqp(seed: int, n: int) -> None:
    q, b, lower, upper = _problem(seed, n)
    scale = 1 / np.sqrt(np.diag(q))
    x, kkt = jax.jit(solve_bounded_qp)(*map(jnp.asarray, (q, b, lower, upper)))
    exact, *_ = daqp.solve(
        q * scale * scale[:, None],
        -b * scale,
        np.zeros((0, n)),
        upper / scale,
        lower / scale,
        np.zeros(n, np.int32),
        primal_tol=1e-12,
        dual_tol=1e-12,
    )
    np.testing.assert_allclose(np.asarray(x) / scale, exact, rtol=1e-8, atol=1e-8)
    assert float(kkt) < 1e-9 * float(np.max(np.abs(x)) + 1)


def _rows(seed: int, n: int, m: int) -> Rows:
    """An equality, a one-sided row and ranges that some point within all bounds keeps."""
    rng = np.random.default_rng(1000 + seed)
    _, _, lower, upper = _problem(seed, n)
    matrix = rng.normal(size=(m, n))
    value = matrix @ (lower + (upper - lower) * rng.uniform(0.2, 0.8, n))
    low, high = value - rng.uniform(0, 0.3, m), value + rng.uniform(0, 0.3, m)
    low[0] = high[0] = value[0]
    high[1:2] = np.inf
    return Rows(*map(jnp.asarray, (matrix, low, high)))


@pytest.mark.parametrize("n, m", [(2, 1), (3, 2), (6, 3)])
@pytest.mark.parametrize("seed", range(8))
def test_with_rows_it_agrees_with_daqp(seed: int, n: int, m: int) -> None:
    q, b, lower, upper = _problem(seed, n)
    rows = _rows(seed, n, m)
    scale = 1 / np.sqrt(np.diag(q))
    x, kkt = jax.jit(solve_bounded_qp)(*map(jnp.asarray, (q, b, lower, upper)), rows)
    exact, _, flag, _ = daqp.solve(
        q * scale * scale[:, None],
        -b * scale,
        np.ascontiguousarray(np.asarray(rows.matrix) * scale),
        np.concatenate([upper / scale, np.minimum(rows.high, 1e30)]),
        np.concatenate([lower / scale, rows.low]),
        np.array([0] * n + [5] + [0] * (m - 1), dtype=np.int32),
        primal_tol=1e-12,
        dual_tol=1e-12,
    )
    assert flag == 1
    np.testing.assert_allclose(np.asarray(x) / scale, exact, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(rows.matrix[0] @ x, rows.low[0], rtol=0, atol=1e-10)
    assert float(kkt) < 1e-8 * float(np.max(np.abs(x)) + 1)


def test_from_boxosqps_guess_it_comes_to_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for few in (bounded_qp._FEW_CHANGES, 0):
        monkeypatch.setattr(bounded_qp, "_FEW_CHANGES", few)
        # A function of its own, or JAX would take what was traced with the other number.
        solve = jax.jit(lambda *given: solve_bounded_qp(*given))
        problems = [(*map(jnp.asarray, _problem(seed, 4)), _rows(seed, 4, 2)) for seed in range(12)]
        found.append(np.array([solve(*problem)[0] for problem in problems]))
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-9)


def test_bounds_that_contradict_each_other_leave_a_residual() -> None:
    q, b, lower, upper = map(jnp.asarray, _problem(1, 3))
    apart = Rows(jnp.eye(1, 3), 1 + upper[:1], 1 + upper[:1])
    _, kkt = solve_bounded_qp(q, b, lower, upper, apart)
    assert float(kkt) > 0.5


def test_the_residual_tells_a_wrong_solution() -> None:
    q, b, lower, upper = map(jnp.asarray, _problem(1, 4))
    x, kkt = solve_bounded_qp(q, b, lower, upper)
    rest = (jnp.zeros(0), q, b, lower, upper, Rows.none(4))
    assert float(kkt_residual(x, *rest)) == float(kkt)
    inwards = 0.9 * x + 0.05 * (lower + upper)
    assert float(kkt_residual(inwards, *rest)) > 1e-3


@pytest.mark.slow
def test_free_and_bounded_derivatives_agree_with_differences() -> None:
    q, b, lower, upper = map(jnp.asarray, _problem(3, 4))
    forward = jax.jacfwd(solve_bounded_qp, argnums=(1, 3), has_aux=True)(q, b, lower, upper)[0]
    backward = jax.jacrev(solve_bounded_qp, argnums=(1, 3), has_aux=True)(q, b, lower, upper)[0]
    step = 1e-6
    for argument, (ahead, back) in zip((1, 3), zip(forward, backward, strict=True), strict=True):
        given = [q, b, lower, upper]
        for j in range(4):
            ends = []
            for sign in (1, -1):
                varied = list(given)
                varied[argument] = varied[argument].at[j].add(sign * step)
                ends.append(np.asarray(solve_bounded_qp(*varied)[0]))
            difference = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(ahead[:, j], difference, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(ahead, back, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_a_batch_is_the_same_as_one_by_one() -> None:
    problems = [_problem(seed, 3) for seed in range(5)]
    batch = [jnp.stack([jnp.asarray(p[k]) for p in problems]) for k in range(4)]
    together, _ = jax.vmap(solve_bounded_qp)(*batch)
    for x, problem in zip(together, problems, strict=True):
        np.testing.assert_allclose(x, solve_bounded_qp(*map(jnp.asarray, problem))[0], rtol=1e-9, atol=1e-12)
