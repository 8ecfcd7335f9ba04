"""Equilibria in great number: each is searched from one nearby, with the factor of an older tangent.

Newton's method with a stale factor (the chord method) converges linearly, at the rate by which the tangents
differ; a new factor is made where a step has not become much shorter than the one before, or is so long that
it turns parts of the body. What has been found also says what is near: one Newton step from it, to other
places and drives, is exact to first order in the difference. Source: Kelley, Iterative Methods for Linear and
Nonlinear Equations, 1995, ch. 5.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from softfuse.body.base import AbstractBody
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.linearised import linearise, loaded_tangents, settled_on
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State

_FAR = 0.01
"""Of the body's size: a step that moves a node further asks for a new factor."""

_SHRINKS = 0.15
"""A step that is longer than this part of the last one asks for a new factor."""


class Found(eqx.Module):
    """A state, the rough factor of a tangent near it, whether it is an equilibrium with no element inside
    out, and how many steps and factors it took.
    """

    state: State
    factor: PyTree[Array]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    factors: Int[Array, ""]


def rough_factor(
    linear: AbstractLinearSolver, body: AbstractBody, loads: Loads, state: State
) -> PyTree[Array]:
    """The factor, good enough to be refined, of the loaded body's tangent at a state."""
    return linear.rough().factor(loaded_tangents(body, loads, state))


def step_to(
    linear: AbstractLinearSolver,
    body: AbstractBody,
    loads: Loads,
    drive: Float[Array, " D"],
    state: State,
    factor: PyTree[Array],
) -> tuple[State, Bool[Array, ""]]:
    """One Newton step from a state towards the equilibrium under `loads` at drives (D,), with a factor of
    `rough_factor`; and whether the loads' laws could be met on the linearised body.

    `loads` may be others than those of the state, such as a disc at another place, with as many unknowns.
    """
    solver = linear.rough()
    at = State(state.z, state.force, state.internal, drive)
    linear_body = linearise(body, loads, lambda b: solver.solve(factor, b), at)
    settled, y = settled_on(linear_body, at)
    force = linear_body.held.force(settled.force, y)
    z = state.z + linear_body.step(settled.force)
    return State(z, force, settled.internal, drive), settled.found


class _Search(eqx.Module):
    state: State
    factor: PyTree[Array]
    length: Float[Array, ""]
    renew: Bool[Array, ""]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]
    factors: Int[Array, ""]


def follow(
    linear: AbstractLinearSolver,
    body: AbstractBody,
    loads: Loads,
    drive: Float[Array, " D"],
    start: State,
    factor: PyTree[Array],
    *,
    step_tolerance: float = 1e-9,
    max_steps: int = 40,
) -> Found:
    """The equilibrium under `loads` at drives (D,), searched from `start` with a factor of a tangent near it.

    It has converged when no displacement changes by more than `step_tolerance` [m]. Unlike `solve`, it takes
    no care of large increments: start near enough. Pure; not meant to be differentiated.
    """

    def unfinished(at: _Search):
        return (at.length > step_tolerance) & (at.steps < max_steps)

    def advance(at: _Search) -> _Search:
        renewed = jax.lax.cond(
            at.renew, lambda: rough_factor(linear, body, loads, at.state), lambda: at.factor
        )
        after, settled = step_to(linear, body, loads, drive, at.state, renewed)
        length = jnp.max(jnp.abs(body.motion(after.z - at.state.z)))
        # A factor that was just made gets a second step before it is judged.
        renew = ((length > _SHRINKS * at.length) & ~at.renew) | (length > far)
        return _Search(after, renewed, length, renew, settled, at.steps + 1, at.factors + at.renew)

    far = _FAR * jnp.max(jnp.ptp(body.rest, axis=0))
    first = _Search(
        start, factor, jnp.array(jnp.inf), jnp.array(False), jnp.array(True), jnp.array(0), jnp.array(0)
    )
    last = jax.lax.while_loop(unfinished, advance, first)
    converged = (last.length <= step_tolerance) & last.settled
    converged &= jnp.min(body.volume_ratios(last.state.z)) > 0
    return Found(last.state, last.factor, converged, last.steps, last.factors)
