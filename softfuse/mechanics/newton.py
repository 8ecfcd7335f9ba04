"""Equilibrium of a body and its loads at prescribed drives, by Newton's method with damping and continuation.

One iteration linearises the body, K δz = Σ f ∂y/∂z − r(z), lets the loads find their forces on the linearised
body (`interface`) and moves along δz by α ≤ 1, the largest of 1, 1/2, ... whose simplified Newton correction,
of body and laws together, shrinks and which turns no element inside out. That test is invariant under scaling
of forces and pressures, so it serves saddle points, whose energy has no minimum (Deuflhard, Newton Methods
for Nonlinear Problems, 2011, Sec. 3.3).

An increment of the drives is halved when it fails, and when it leaves the path: where t₀ and t₁ are the
motions that the increment asks for by the tangents at its ends, a smooth path has moved by (t₀ + t₁)/2 up to
third order; one on which something begins to touch has after some halving; a body that has snapped is
elsewhere. The result is differentiated implicitly, in both modes and to any order, in
body, loads and drives.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.mechanics.interface import slopes, stiffness
from softfuse.mechanics.linear_solver import AbstractLinearSolver, Solve, tangent_inverse
from softfuse.mechanics.linearised import (
    coupled,
    linearise,
    loaded_tangents,
    settled_on,
    stiffness_map,
    unbalanced,
)
from softfuse.mechanics.load import HeldLoads, Loads
from softfuse.mechanics.solution import RESULTS, Solution, State, Stats

_SMALLEST_DAMPING = 1 / 64

_LARGEST_DEPARTURE = 0.55
"""Part of an increment's motion by which it may miss the mean of its tangents."""

_SOFTENED = 3.0
"""So many times softer than at the first increment, a path that ends is taken to end at a limit load."""


class Newton(eqx.Module):
    """Settings of the solve: `step_tolerance` [m] ends an increment when no displacement changes by more."""

    linear: AbstractLinearSolver
    step_tolerance: float = eqx.field(static=True, default=1e-9)
    max_iterations: int = eqx.field(static=True, default=12)
    max_load_steps: int = eqx.field(static=True, default=60)
    smallest_load_step: float = eqx.field(static=True, default=1 / 256)


class _Iterate(eqx.Module):
    state: State
    first: tuple[Float[Array, " n"], Float[Array, " n"]]  # Newton step, and its part due to the drives
    along: Float[Array, " n"]  # what the drives' increment moves by the last tangent
    left: Float[Array, ""]
    count: Int[Array, ""]
    damping: Float[Array, ""]
    inverted: Bool[Array, ""]


class _March(eqx.Module):
    state: State
    reached: Float[Array, ""]
    increment: Float[Array, ""]
    iterations: Int[Array, ""]
    accepted: Int[Array, ""]
    attempts: Int[Array, ""]
    inverted: Bool[Array, ""]
    first_softness: Float[Array, ""]
    softness: Float[Array, ""]
    jumped: Bool[Array, ""]


def _iterate(newton: Newton, body: AbstractBody, loads: Loads, change: Array, at: _Iterate) -> _Iterate:
    # Each iteration solves only for what is out of balance, so that a rough factor serves.
    solver, state = newton.linear.rough(), at.state
    factor = solver.factor(loaded_tangents(body, loads, state))

    def inverse(b):
        return solver.solve(factor, b)

    linear = linearise(body, loads, inverse, state)
    held = linear.held
    settled, y = settled_on(linear, state)
    slope = slopes(held, (settled.force, settled.internal), y, state.drive)
    force = held.force(settled.force, y)
    system = coupled(loads, linear, slope)
    step = linear.step(settled.force)
    towards = jnp.linalg.solve(system.whole, -slope.drive @ change)
    along = linear.response @ towards[: settled.force.shape[0]]
    length = jnp.where(settled.found, jnp.max(jnp.abs(body.motion(step))), jnp.nan)

    def moved(damping):
        return State(
            state.z + damping * step,
            state.force + damping * (force - state.force),
            state.internal + damping * (settled.internal - state.internal),
            state.drive,
        )

    def rejected(damping):
        trial = moved(damping)
        flipped = ~(jnp.min(body.volume_ratios(trial.z)) > 0)
        missing = loads.equations(trial.force, trial.internal, loads.values(body, trial.z), trial.drive)
        left = unbalanced(body, loads, trial)
        correction, _ = system.respond(inverse(-left[:, None]), -missing[:, None])
        small = jnp.max(jnp.abs(body.motion(correction))) <= jnp.maximum(
            (1 - damping / 4) * length, newton.step_tolerance
        )
        return flipped, flipped | ~small

    def halve(carry):
        damping, flipped, _ = carry
        flips, refused = rejected(damping / 2)
        return damping / 2, flipped | flips, refused

    # From twice the whole step: what is in a loop is compiled once.
    before = jnp.array(2.0), jnp.array(False), jnp.array(True)
    damping, flipped, _ = jax.lax.while_loop(
        lambda carry: carry[2] & (carry[0] >= _SMALLEST_DAMPING), halve, before
    )
    # A step that was damped is not the last one, however short.
    left = jnp.where(damping == 1.0, length, jnp.maximum(length, 2 * newton.step_tolerance))
    first = jax.tree.map(lambda new, old: jnp.where(at.count == 0, new, old), (step, along), at.first)
    return _Iterate(moved(damping), first, along, left, at.count + 1, damping, flipped)


def _increment(
    newton: Newton, body: AbstractBody, loads: Loads, start: State, change: Array
) -> tuple[_Iterate, Array, Array]:
    """Newton's method at the drives of `start`, by which these have changed: its end, whether it converged,
    and by which part of its motion it missed the mean of its tangents.
    """

    def unfinished(at: _Iterate):
        alive = (at.damping >= _SMALLEST_DAMPING) & ~jnp.isnan(at.left)
        return alive & (at.count < newton.max_iterations) & ~(at.left <= newton.step_tolerance)

    still = jnp.zeros(body.n)
    first = _Iterate(
        start, (still, still), still, jnp.array(jnp.inf), jnp.array(0), jnp.array(1.0), jnp.array(False)
    )
    last = jax.lax.while_loop(unfinished, lambda at: _iterate(newton, body, loads, change, at), first)
    done = (last.left <= newton.step_tolerance) & ~last.inverted

    def size(motion):
        return jnp.linalg.norm(body.motion(motion))

    (step, begin), went = last.first, last.state.z - start.z
    # What the first step settled was not of the drives' doing.
    missed = size(went - (step - begin) - (begin + last.along) / 2)
    return last, done, missed / (size(went) + newton.step_tolerance)


def _march(newton: Newton, body: AbstractBody, loads: Loads, drive: Array, start: State) -> Solution:
    initial = start.drive

    def attempt(at: _March) -> _March:
        reached = jnp.minimum(at.reached + at.increment, 1.0)
        part = jnp.where(reached < 1.0, initial + reached * (drive - initial), drive)
        aim = eqx.tree_at(lambda s: s.drive, at.state, part)
        end, balanced, departure = _increment(newton, body, loads, aim, part - at.state.drive)
        done = balanced & (departure <= _LARGEST_DEPARTURE)
        softness = jnp.linalg.norm(body.motion(end.along)) / (reached - at.reached)
        first = jnp.where(at.accepted == 0, softness, at.first_softness)
        state = jax.tree.map(lambda new, old: jnp.where(done, new, old), end.state, at.state)
        return _March(
            state,
            jnp.where(done, reached, at.reached),
            at.increment * jnp.where(done, 2.0, 0.5),
            at.iterations + end.count,
            at.accepted + done,
            at.attempts + 1,
            ~done & (at.inverted | end.inverted),
            jnp.where(done, first, at.first_softness),
            jnp.where(done, softness, at.softness),
            ~done & (at.jumped | balanced),
        )

    def unfinished(at: _March):
        return (
            (at.reached < 1.0)
            & (at.increment >= newton.smallest_load_step)
            & (at.attempts < newton.max_load_steps)
        )

    zero, none, no = jnp.array(0), jnp.array(0.0), jnp.array(False)
    first = _March(start, none, jnp.array(1.0), zero, zero, zero, no, none, none, no)
    last = jax.lax.while_loop(unfinished, attempt, first)
    failed = RESULTS.where(last.inverted, RESULTS.inverted, RESULTS.diverged)
    limit = last.jumped | (last.softness > _SOFTENED * last.first_softness)
    failed = RESULTS.where(limit, RESULTS.snapped, failed)
    failed = RESULTS.where(last.attempts >= newton.max_load_steps, RESULTS.step_limit, failed)
    result = RESULTS.where(last.reached >= 1.0, RESULTS.converged, failed)
    left = jnp.max(jnp.abs(body.forces(unbalanced(body, loads, last.state))))
    return Solution(last.state, result, Stats(last.iterations, last.accepted, left))


@eqx.filter_custom_jvp
def _equilibrium(body: AbstractBody, loads: Loads, drive: Array, newton: Newton, start: State) -> Solution:
    return _march(newton, body, loads, drive, start)


@_equilibrium.def_jvp
def _equilibrium_jvp(primals, tangents):
    body, loads, drive, newton, start = primals
    body_dot, loads_dot, drive_dot, _, _ = tangents
    solution = _equilibrium(body, loads, drive, newton, start)
    state = solution.state
    x, q = (state.force, state.internal), state.force.shape[0]
    drive_dot = jnp.zeros_like(drive) if drive_dot is None else drive_dot

    def unsolved(body, loads):
        """Balance and laws at the solution's unknowns."""
        return unbalanced(body, loads, state), loads.equations(*x, loads.values(body, state.z), state.drive)

    _, (left_dot, law_dot) = eqx.filter_jvp(unsolved, (body, loads), (body_dot, loads_dot))
    # None: neither body nor loads are varied in what these depend on.
    left_dot, law_dot = (0.0 if dot is None else dot for dot in (left_dot, law_dot))
    inverse = tangent_at(newton.linear, body, loads, state)
    rows = loads.rows(body, state.z)
    response = inverse(rows[:, loads.carrying])
    relaxed = inverse(jnp.zeros((body.n, 1)) - jnp.reshape(left_dot, (-1, 1)))[:, 0]
    y = loads.values(body, state.z)
    slope = slopes(HeldLoads(loads, y), x, y, state.drive)
    right = law_dot + slope.y @ (rows.T @ relaxed) + slope.drive @ drive_dot
    x_dot = -jnp.linalg.solve(stiffness(slope, rows.T @ response), right)
    z_dot = relaxed + response @ x_dot[:q]
    force_dot = x_dot[:q] - loads.supports * (rows[:, loads.carrying].T @ z_dot)
    none = jax.tree.map(lambda _: None, solution)
    tangent = eqx.tree_at(
        lambda s: (s.state.z, s.state.force, s.state.internal, s.state.drive, s.stats.residual),
        none,
        (z_dot, force_dot, x_dot[q:], drive_dot, jnp.zeros_like(solution.stats.residual)),
        is_leaf=lambda leaf: leaf is None,
    )
    return solution, tangent


def tangent_at(linear: AbstractLinearSolver, body: AbstractBody, loads: Loads, state: State) -> Solve:
    """K⁻¹ at a state by a factor of K itself, as a differentiable map (`linear_solver.tangent_inverse`)."""
    factor = linear.factor(loaded_tangents(*jax.lax.stop_gradient((body, loads, state))))
    return tangent_inverse(linear, factor, stiffness_map(body, loads, state), refinements=0)


def solve(
    newton: Newton, body: AbstractBody, loads: Loads, drive: Float[Array, " D"], start: State
) -> Solution:
    """The equilibrium of a body under its loads, by continuation of their drives from those of `start`.

    `drive` (D,): what is prescribed, in the order of the loads. Never raises: `Solution.result` says how it
    ended. Differentiable in body, loads and drive by the implicit function theorem; start only says where to
    search.
    """
    return _equilibrium(body, loads, drive, newton, start)
