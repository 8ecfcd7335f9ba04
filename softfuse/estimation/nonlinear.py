"""The converged estimate: forces whose equilibrium explains the measured volumes best, and its implicit
derivative.

F* = argmin Σ_i ((ΔV_i(F) − ΔV_measured,i) / σ_i)², 0 ≤ F ≤ F_max, with ΔV(F) through the full equilibrium, by
Gauss-Newton steps on W = jacfwd ΔV. On the unbounded forces h(F, θ) = Wᵀ R⁻¹ (ΔV − ΔV_measured) = 0 holds for
all θ, hence dF = −(∂h/∂F)⁻¹ ∂h/∂θ dθ: exact in every parameter θ of device, measurement and location, second
derivatives of the body included.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.equilibrium.solution import State
from softfuse.estimation.bounded_qp import solve_bounded_qp
from softfuse.estimation.device import Device, compliance, simulate
from softfuse.estimation.step import Limits, Observation


class ConvergedForce(eqx.Module):
    """Forces (c,) [N], whether the steps converged, and how many there were."""

    force: Float[Array, " c"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


def _slope(device: Device, seen: Observation, start: State, force: Float[Array, " c"]) -> Float[Array, " c"]:
    """h (c,) [1/N]: half the gradient of the weighted misfit."""
    value = device.volume_change(simulate(device, seen.locations, force, start).state.z)
    misfit = jnp.where(seen.weight > 0, (value - seen.volume_change) * seen.weight**2, 0.0)
    return compliance(device, seen.locations, force, start).T @ misfit


@eqx.filter_custom_jvp
def _converged(device: Device, seen: Observation, limits: Limits, start: State, steps: int) -> ConvergedForce:
    tolerance = 1e-9 * jnp.max(limits.force)

    def improve(carry):
        force, _, count = carry
        w = compliance(device, seen.locations, force, start)
        whitened = w * seen.weight[:, None]
        q = whitened.T @ whitened + limits.regularisation * jnp.eye(len(force))
        slope = _slope(device, seen, start, force)
        change, _ = solve_bounded_qp(q, -slope, -force, limits.force - force)
        return force + change, jnp.max(jnp.abs(change)), count + 1

    first = (start.force(), jnp.array(jnp.inf), jnp.array(0))
    force, change, count = jax.lax.while_loop(
        lambda carry: (carry[1] > tolerance) & (carry[2] < steps), improve, first
    )
    return ConvergedForce(force, change <= tolerance, count)


@_converged.def_jvp
def _converged_jvp(primals, tangents):
    device, seen, limits, start, steps = primals
    found = _converged(device, seen, limits, start, steps)
    device_dot, seen_dot, _, _, _ = tangents
    force = found.force
    free = (force > 0) & (force < limits.force)
    _, slope_dot = eqx.filter_jvp(
        lambda device, seen: _slope(device, seen, start, force), (device, seen), (device_dot, seen_dot)
    )
    curvature = jax.jacfwd(lambda f: _slope(device, seen, start, f))(force)
    matrix = jnp.where(free[:, None] & free, curvature, 0.0) + jnp.diag(jnp.where(free, 0.0, 1.0))
    force_dot = -jnp.linalg.solve(matrix, jnp.where(free, slope_dot, 0.0))
    none = jax.tree.map(lambda _: None, found)
    return found, eqx.tree_at(lambda f: f.force, none, force_dot, is_leaf=lambda leaf: leaf is None)


def nonlinear_estimate(
    device: Device, limits: Limits, start: State, seen: Observation, *, steps: int = 25
) -> ConvergedForce:
    """The forces that explain an observation best; differentiable in device and observation at constant cost
    in `steps`.

    `start`: an equilibrium to search from. The shape is `simulate(device, seen.locations, force).state`.
    """
    return _converged(device, seen, limits, start, steps)
