"""min ½ xᵀQx − bᵀx subject to lower ≤ x ≤ upper and low ≤ A x ≤ high, for a few unknowns (Navarro et al.
2020, eqs. 9 and 10).

On the problem with unit diagonal and rows of unit length active-set steps find the active bounds, from none
where a few of them do, else from those that jaxopt's BoxOSQP says, and correct what its tolerance left open.
The last of them, a direct solve, is what gets differentiated. The KKT residual says how far the result is
from optimal, in units of x. This is the only file that knows jaxopt.
"""

import warnings
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

_NO_BOUND = 1e15  # of a scaled unknown: stands for an infinite bound
_ROUNDING = 1e-10  # by which a row may miss its bound
_MAX_CHANGES, _FEW_CHANGES = 30, 4
_DEPENDENT = 1e-13  # active rows that say the same share their multiplier


class Rows(eqx.Module):
    """low (m,) ≤ A x ≤ high (m,) for a matrix A (m, n); equal bounds are an equality, infinite ones none."""

    matrix: Float[Array, "m n"]
    low: Float[Array, " m"]
    high: Float[Array, " m"]

    @classmethod
    def none(cls, n: int) -> "Rows":
        """No rows on n unknowns."""
        return cls(jnp.zeros((0, n)), jnp.zeros(0), jnp.zeros(0))

    def joined(self, others: "Rows") -> "Rows":
        """These rows, then others of the same unknowns."""
        return jax.tree.map(lambda *each: jnp.concatenate(each), self, others)


class _Search(NamedTuple):
    """Which rows (m,) are taken to be active, whether that changed last, and how often it was looked at."""

    at_low: Bool[Array, " m"]
    at_high: Bool[Array, " m"]
    changed: Bool[Array, ""]
    count: Int[Array, ""]


def kkt_residual(
    x: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    q: Float[Array, "n n"],
    b: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    rows: Rows,
) -> Float[Array, ""]:
    """Distance from optimality in units of x; 0 exactly at the solution.

    The largest of: the distance of x (n,) from its projected Jacobi step, under multipliers (m,) of the rows;
    and how far the most effective unknown of a row would have to move to keep the row's bounds.
    """
    slope = q @ x - b + rows.matrix.T @ multipliers
    stationary = jnp.max(jnp.abs(x - jnp.clip(x - slope / jnp.diag(q), lower, upper)))
    value = rows.matrix @ x
    size = jnp.max(jnp.abs(rows.matrix), axis=1) if rows.low.size else jnp.zeros(0)
    violated = jnp.abs(value - jnp.clip(value, rows.low, rows.high)) / jnp.where(size > 0, size, 1.0)
    return jnp.maximum(stationary, jnp.max(violated, initial=0.0))


def solve_bounded_qp(
    q: Float[Array, "n n"],
    b: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    rows: Rows | None = None,
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """Solution (n,) and KKT residual for positive definite q (n, n), b (n,), lower ≤ upper (n,) and rows.

    Differentiable in all arguments where no bound is about to become active or inactive. Bounds that
    contradict each other leave a large KKT residual.
    """
    n = len(b)
    rows = Rows.none(n) if rows is None else rows
    scale = 1 / jnp.sqrt(jnp.diag(q))
    matrix = jnp.concatenate([jnp.eye(n), rows.matrix * scale])
    length = jnp.linalg.norm(matrix, axis=1)
    length = jnp.where(length > 0, length, 1.0)
    matrix = matrix / length[:, None]
    low = jnp.concatenate([lower / scale, rows.low]) / length
    high = jnp.concatenate([upper / scale, rows.high]) / length
    scaled_q, scaled_b = q * scale[:, None] * scale, b * scale
    at_low, at_high = _active(*jax.lax.stop_gradient((scaled_q, scaled_b, matrix, low, high)))
    found, y = _held(scaled_q, scaled_b, matrix, low, high, at_low, at_high)
    x = jnp.clip(found * scale, lower, upper)
    # A multiplier of the wrong sign belongs to a bound that should not be active: let the residual say so.
    y = jnp.where(
        at_low & ~at_high, jnp.minimum(y, 0.0), jnp.where(at_high & ~at_low, jnp.maximum(y, 0.0), y)
    )
    return x, kkt_residual(x, y[n:] / length[n:], q, b, lower, upper, rows)


def _held(
    q: Array, b: Array, matrix: Array, low: Array, high: Array, at_low: Array, at_high: Array
) -> tuple[Array, Array]:
    """The optimum (n,) that holds the active rows (m,) as equalities, and their multipliers (m,)."""
    n, active = len(b), at_low | at_high
    held = jnp.where(at_low, low, jnp.where(at_high, high, 0.0))
    on = jnp.where(active[:, None], matrix, 0.0)
    exact = jnp.block([[q, on.T], [on, jnp.diag(jnp.where(active, 0.0, 1.0))]])
    softened = exact - _DEPENDENT * jnp.diag(jnp.concatenate([jnp.zeros(n), active]))
    factor = jax.scipy.linalg.lu_factor(softened)
    right = jnp.concatenate([b, held])
    found = jax.scipy.linalg.lu_solve(factor, right)
    # The softening leaves the solution again where there is one without it.
    found = found + jax.scipy.linalg.lu_solve(factor, right - exact @ found)
    return found[:n], found[n:]


@cache
def _solver() -> Any:
    # Where no program is traced, nobody waits for it and for what it imports.
    with warnings.catch_warnings():
        # It says on import that it is no longer developed: known, and the reason why it lives here only.
        warnings.simplefilter("ignore", DeprecationWarning)
        from jaxopt import BoxOSQP
    return BoxOSQP(tol=1e-8, maxiter=4000, check_primal_dual_infeasability=False, jit=True)


def _active(q: Array, b: Array, matrix: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Which of the rows (m,) sit on their lower and on their upper bound; both for equalities."""
    low, high = jnp.maximum(low, -_NO_BOUND), jnp.minimum(high, _NO_BOUND)
    equal = low == high

    def update(carry: _Search) -> _Search:
        x, y = _held(q, b, matrix, low, high, carry.at_low, carry.at_high)
        value = matrix @ x
        on_low = equal | jnp.where(carry.at_low, y < 0, value < low - _ROUNDING * (1 + jnp.abs(low)))
        on_high = equal | jnp.where(carry.at_high, y > 0, value > high + _ROUNDING * (1 + jnp.abs(high)))
        changed = jnp.any((on_low != carry.at_low) | (on_high != carry.at_high))
        return _Search(on_low, on_high, changed, carry.count + 1)

    def searched(at_low: Array, at_high: Array, most: int) -> _Search:
        first = _Search(at_low, at_high, jnp.array(True), jnp.array(0))
        return jax.lax.while_loop(lambda at: at.changed & (at.count < most), update, first)

    def with_guess(at: _Search) -> _Search:
        # XLA computes before a loop what does not depend on its carry, even where it is never entered; so -b
        # comes by way of the carry. Where the guess is used, `changed` is true.
        objective = q, jnp.where(at.changed, -b, 0.0)
        found = _solver().run(params_obj=objective, params_eq=matrix, params_ineq=(low, high)).params
        value = found.primal[1]
        up, down = found.dual_ineq
        return searched(equal | (down > value - low), equal | (up > high - value), _MAX_CHANGES)

    # What an active set that does not change any more says are the conditions of optimality. A loop that ends
    # after its first pass: in a batch both sides of a `cond` would always be computed.
    near = searched(equal, equal, _FEW_CHANGES)._replace(count=jnp.array(0))
    last = jax.lax.while_loop(
        lambda at: at.changed & (at.count == 0), lambda at: with_guess(at)._replace(count=jnp.array(1)), near
    )
    return last.at_low, last.at_high
