"""Equilibrium of a body and its loads at prescribed drives, by continuation of these and of its weight.

Each increment of the drives is searched by Newton's method (`increment`). One is halved when it fails, and
when it leaves the path: where t₀ and t₁ are the motions that the increment asks for by the tangents at its
ends, a smooth path has moved by (t₀ + t₁)/2 up to third order; one on which something begins to touch has
after some halving; a body that has snapped is elsewhere. Where no increment is short enough the path has
ended, at a limit load: there the body flows to the next stable equilibrium, and the search goes on from it.

A body's weight is continued along with the drives, from that part of it which the start carries already. The
result is differentiated implicitly, in both modes and to any order, in body, loads and drives.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.mechanics.held_loads import HeldLoads
from softfuse.mechanics.increment import Increment, Target, first_drag, search
from softfuse.mechanics.interface import slopes, stiffness
from softfuse.mechanics.linear_solver import AbstractLinearSolver, Solve, tangent_inverse
from softfuse.mechanics.linearised import loaded_tangents, stiffness_map, unbalanced
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import RESULTS, Solution, State, Stats

_LARGEST_DEPARTURE = 0.55
"""Part of an increment's motion by which it may miss the mean of its tangents."""

_FLOW_INCREMENT = 4.0
"""So many of the shortest increments lie between where a path ends and the load at which the body flows."""


class Newton(eqx.Module):
    """Settings of the solve: `step_tolerance` [m] ends an increment when no displacement changes by more."""

    linear: AbstractLinearSolver
    step_tolerance: float = eqx.field(static=True, default=1e-9)
    max_iterations: int = eqx.field(static=True, default=25)
    max_load_steps: int = eqx.field(static=True, default=60)
    smallest_load_step: float = eqx.field(static=True, default=1 / 256)


class _March(eqx.Module):
    state: State
    reached: Float[Array, ""]
    increment: Float[Array, ""]
    flows: Bool[Array, ""]
    ended: Bool[Array, ""]
    inverted: Bool[Array, ""]
    iterations: Int[Array, ""]
    accepted: Int[Array, ""]
    attempts: Int[Array, ""]
    snaps: Int[Array, ""]


def _departure(body: AbstractBody, start: State, end: Increment, tolerance: float) -> Float[Array, ""]:
    """By which part of its motion an increment missed the mean of its tangents."""

    def size(motion):
        return jnp.linalg.norm(body.motion(motion))

    (step, begin), went = end.first, end.state.z - start.z
    # What the first step settled was not of the drives' doing.
    missed = size(went - (step - begin) - (begin + end.along) / 2)
    return missed / (size(went) + tolerance)


def _carried(body: AbstractBody, loads: Loads, start: State) -> Float[Array, ""]:
    """Which part of a body's weight its start carries already, by least squares: 0 at rest, 1 in balance."""
    size = body.weight @ body.weight
    missing = body.weight @ unbalanced(body, loads, start) / jnp.where(size > 0, size, 1.0)
    return jnp.where(size > 0, jnp.clip(1.0 + missing, 0.0, 1.0), 1.0)


def _march(newton: Newton, body: AbstractBody, loads: Loads, drive: Array, start: State) -> Solution:
    initial, carried = start.drive, _carried(body, loads, start)

    def part(reached):
        """The drives and the body on the way."""
        drives = jnp.where(reached < 1.0, initial + reached * (drive - initial), drive)
        share = jnp.where(reached < 1.0, carried + reached * (1.0 - carried), 1.0)
        return drives, eqx.tree_at(lambda b: b.weight, body, share * body.weight)

    def attempt(at: _March) -> _March:
        reached = jnp.minimum(at.reached + at.increment, 1.0)
        drives, weighing = part(reached)
        change = (reached - at.reached) * (1.0 - carried) * body.weight
        end = search(
            newton.linear,
            weighing,
            loads,
            at.state,
            Target(drives, drives - at.state.drive, change),
            drag=jnp.where(at.flows, first_drag(body), 0.0),
            tolerance=newton.step_tolerance,
            max_iterations=newton.max_iterations,
        )
        on_path = _departure(body, at.state, end, newton.step_tolerance) <= _LARGEST_DEPARTURE
        done = end.found & (on_path | at.flows)
        increment = at.increment * jnp.where(done, 2.0, 0.5)
        shortest = newton.smallest_load_step
        path_ends = ~done & ~at.flows & (increment < shortest) & ~end.inverted
        failed = ~done & (at.flows | (increment < shortest)) & ~path_ends
        return _March(
            jax.tree.map(lambda new, old: jnp.where(done, new, old), end.state, at.state),
            jnp.where(done, reached, at.reached),
            jnp.where(path_ends, _FLOW_INCREMENT * shortest, increment),
            path_ends,
            failed,
            end.inverted & ~done,
            at.iterations + end.count,
            at.accepted + done,
            at.attempts + 1,
            at.snaps + (done & at.flows),
        )

    def unfinished(at: _March):
        return (at.reached < 1.0) & ~at.ended & (at.attempts < newton.max_load_steps)

    zero, no = jnp.array(0), jnp.array(False)
    first = _March(start, jnp.array(0.0), jnp.array(1.0), no, no, no, zero, zero, zero, zero)
    last = jax.lax.while_loop(unfinished, attempt, first)
    failed = RESULTS.where(last.inverted, RESULTS.inverted, RESULTS.diverged)
    failed = RESULTS.where(last.attempts >= newton.max_load_steps, RESULTS.step_limit, failed)
    found = RESULTS.where(last.snaps > 0, RESULTS.snapped, RESULTS.converged)
    result = RESULTS.where(last.reached >= 1.0, found, failed)
    left = unbalanced(part(last.reached)[1], loads, last.state)
    residual = jnp.max(jnp.abs(body.forces(left)))
    stats = Stats(last.iterations, last.accepted, last.snaps, last.reached, residual)
    return Solution(last.state, result, stats)


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

    def stats(solution):
        return solution.stats.reached, solution.stats.residual

    tangent = eqx.tree_at(
        lambda s: (s.state.z, s.state.force, s.state.internal, s.state.drive, *stats(s)),
        none,
        (z_dot, force_dot, x_dot[q:], drive_dot, *(jnp.zeros_like(each) for each in stats(solution))),
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
