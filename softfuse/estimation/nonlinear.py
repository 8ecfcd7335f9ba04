"""The converged estimate: drives whose equilibrium explains the readings best, and its implicit derivative.

u* = argmin |L⁻¹ (s(u) − s_measured)|², u_min ≤ u ≤ u_max, with s(u) through the full equilibrium, S = L Lᵀ,
by Gauss-Newton steps on W = jacfwd s. On the unbounded drives h(u, θ) = Wᵀ S⁻¹ (s − s_measured) = 0 holds for
all θ, hence du = −(∂h/∂u)⁻¹ ∂h/∂θ dθ: exact in every parameter θ of robot, measurement and place, second
derivatives of the body included.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.estimation.bounded_qp import solve_bounded_qp
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import State


class Converged(eqx.Module):
    """Drives (D,), whether the steps converged, and how many there were."""

    drive: Float[Array, " D"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class _Misfit(NamedTuple):
    """At some drives: W (k, D), and half the gradient h (D,) [1/drive] of the weighted misfit."""

    compliance: Float[Array, "k D"]
    slope: Float[Array, " D"]


def _misfit(model: Model, seen: Observation, start: State, drive: Float[Array, " D"]) -> _Misfit:
    def read(given):
        value = model.reading(simulate(model, seen.places, given, start).state, seen.places)
        return value, value

    # One equilibrium for both.
    w, value = jax.jacfwd(read, has_aux=True)(drive)
    return _Misfit(w, (seen.whitening @ w).T @ seen.heard(value - seen.reading))


@eqx.filter_custom_jvp
def _converged(model: Model, seen: Observation, limits: Limits, start: State, steps: int) -> Converged:
    tolerance = 1e-9 * (limits.upper - limits.lower)

    def improve(carry):
        drive, _, count = carry
        at = _misfit(model, seen, start, drive)
        whitened = seen.whitening @ at.compliance
        q = whitened.T @ whitened + jnp.diag(limits.regularisation)
        change, _ = solve_bounded_qp(q, -at.slope, limits.lower - drive, limits.upper - drive)
        return drive + change, jnp.any(jnp.abs(change) > tolerance), count + 1

    first = (start.drive, jnp.array(True), jnp.array(0))
    drive, moving, count = jax.lax.while_loop(lambda carry: carry[1] & (carry[2] < steps), improve, first)
    return Converged(drive, ~moving, count)


@_converged.def_jvp
def _converged_jvp(primals, tangents):
    model, seen, limits, start, steps = primals
    found = _converged(model, seen, limits, start, steps)
    model_dot, seen_dot, _, _, _ = tangents
    drive = found.drive
    free = (drive > limits.lower) & (drive < limits.upper)
    _, slope_dot = eqx.filter_jvp(
        lambda model, seen: _misfit(model, seen, start, drive).slope, (model, seen), (model_dot, seen_dot)
    )
    curvature = jax.jacfwd(lambda u: _misfit(model, seen, start, u).slope)(drive)
    matrix = jnp.where(free[:, None] & free, curvature, 0.0) + jnp.diag(jnp.where(free, 0.0, 1.0))
    drive_dot = -jnp.linalg.solve(matrix, jnp.where(free, slope_dot, 0.0))
    none = jax.tree.map(lambda _: None, found)
    return found, eqx.tree_at(lambda f: f.drive, none, drive_dot, is_leaf=lambda leaf: leaf is None)


def nonlinear_estimate(
    model: Model, limits: Limits, start: State, seen: Observation, *, steps: int = 25
) -> Converged:
    """The drives that explain an observation best, its places taken to be known; differentiable in robot and
    observation at constant cost in `steps`.

    `start`: an equilibrium to search from. The shape is `simulate(robot, seen.places, drive).state`.
    """
    return _converged(model, seen, limits, start, steps)
