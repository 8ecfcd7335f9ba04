"""Equilibrium r(z) = Σ_k a_k G_k under discs of prescribed total force, by Newton's method with damping and
load continuation.

One iteration linearises the body, K δz = G a − r(z), distributes the forces a over the pressure cells
(`unilateral`) and moves along δz by α ≤ 1, the largest of 1, 1/2, ... whose simplified Newton correction
K⁻¹(G a − r) shrinks and which turns no element inside out. That test is invariant under scaling of forces and
pressures, so it serves saddle points, whose energy has no minimum (Deuflhard, Newton Methods for Nonlinear
Problems, 2011, Sec. 3.3). If an increment of force fails it is halved. The result is differentiated
implicitly, in both modes and to any order, in body, contacts and forces.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.body import Body, element_tangents, residual, volume_ratios
from softfuse.equilibrium.linear_solver import AbstractLinearSolver, tangent_inverse
from softfuse.equilibrium.solution import RESULTS, Solution, State, Stats
from softfuse.equilibrium.unilateral import distribute, distribute_on

_SMALLEST_DAMPING = 1 / 64


class Newton(eqx.Module):
    """Settings of the solve: `step_tolerance` [m] ends an increment when no displacement changes by more."""

    linear: AbstractLinearSolver
    step_tolerance: float = eqx.field(static=True, default=1e-9)
    max_iterations: int = eqx.field(static=True, default=12)
    max_load_steps: int = eqx.field(static=True, default=60)
    smallest_load_step: float = eqx.field(static=True, default=1 / 256)


class _Iterate(eqx.Module):
    state: State
    change: Float[Array, ""]
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


def compliance_of(rows: Float[Array, "n c m"], response: Float[Array, "n c m"]) -> Float[Array, "c m c m"]:
    """S = Gᵀ K⁻¹ G (c, m, c, m) [m/N] of contact rows G and responses K⁻¹ G, both (n, c, m)."""
    return jnp.einsum("ncm,ndk->cmdk", rows, response)


def unbalanced(body: Body, rows: Float[Array, "n c m"], state: State) -> Float[Array, " n"]:
    """r(z) − G a (n,): what is left of the equilibrium equations."""
    return residual(body, state.z) - jnp.einsum("ncm,cm->n", rows, state.cells)


def _iterate(newton: Newton, body: Body, rows: Array, force: Array, at: _Iterate) -> _Iterate:
    n, c, m = rows.shape
    solver, state = newton.linear, at.state
    factor = solver.factor(element_tangents(body, state.z))
    both = jnp.concatenate([rows.reshape(n, c * m), residual(body, state.z)[:, None]], axis=1)
    solved = solver.solve(factor, both)
    response, relaxed = solved[:, :-1].reshape(n, c, m), state.z - solved[:, -1]
    offset = jnp.einsum("ncm,n->cm", rows, relaxed)
    cells, depth, pressed = distribute(state.pressed, compliance_of(rows, response), offset, force)
    step = relaxed + jnp.einsum("ncm,cm->n", response, cells) - state.z
    moves = slice(0, body.n_displacements)
    length = jnp.max(jnp.abs(step[moves]))

    def moved(damping):
        return State(
            state.z + damping * step,
            state.cells + damping * (cells - state.cells),
            state.depth + damping * (depth - state.depth),
            pressed,
        )

    def rejected(damping):
        trial = moved(damping)
        flipped = ~(jnp.min(volume_ratios(body, trial.z)) > 0)
        correction = solver.solve(factor, unbalanced(body, rows, trial)[:, None])[moves, 0]
        small = jnp.max(jnp.abs(correction)) <= jnp.maximum((1 - damping / 4) * length, newton.step_tolerance)
        return flipped, flipped | ~small

    def halve(carry):
        damping, flipped, _ = carry
        flips, refused = rejected(damping / 2)
        return damping / 2, flipped | flips, refused

    damping, flipped, _ = jax.lax.while_loop(
        lambda carry: carry[2] & (carry[0] >= _SMALLEST_DAMPING), halve, (jnp.array(1.0), *rejected(1.0))
    )
    # A step that was damped is not the last one, however short.
    change = jnp.where(damping == 1.0, length, jnp.maximum(length, 2 * newton.step_tolerance))
    return _Iterate(moved(damping), change, at.count + 1, damping, flipped)


def _increment(
    newton: Newton, body: Body, rows: Array, force: Array, start: State
) -> tuple[State, Array, Array, Array]:
    """Newton's method at one force: state, whether it converged, iterations, whether an element flipped."""

    def unfinished(at: _Iterate):
        alive = (at.damping >= _SMALLEST_DAMPING) & ~jnp.isnan(at.change)
        return alive & (at.count < newton.max_iterations) & ~(at.change <= newton.step_tolerance)

    first = _Iterate(start, jnp.array(jnp.inf), jnp.array(0), jnp.array(1.0), jnp.array(False))
    last = jax.lax.while_loop(unfinished, lambda at: _iterate(newton, body, rows, force, at), first)
    done = (last.change <= newton.step_tolerance) & ~last.inverted
    return last.state, done, last.count, last.inverted


def _march(
    newton: Newton, body: Body, rows: Array, force: Array, start: State
) -> tuple[State, RESULTS, Stats]:
    initial = start.force()

    def attempt(at: _March) -> _March:
        reached = jnp.minimum(at.reached + at.increment, 1.0)
        state, done, count, inverted = _increment(
            newton, body, rows, initial + reached * (force - initial), at.state
        )
        state = jax.tree.map(lambda new, old: jnp.where(done, new, old), state, at.state)
        return _March(
            state,
            jnp.where(done, reached, at.reached),
            at.increment * jnp.where(done, 2.0, 0.5),
            at.iterations + count,
            at.accepted + done,
            at.attempts + 1,
            ~done & (at.inverted | inverted),
        )

    def unfinished(at: _March):
        return (
            (at.reached < 1.0)
            & (at.increment >= newton.smallest_load_step)
            & (at.attempts < newton.max_load_steps)
        )

    zero = jnp.array(0)
    first = _March(start, jnp.array(0.0), jnp.array(1.0), zero, zero, zero, jnp.array(False))
    last = jax.lax.while_loop(unfinished, attempt, first)
    failed = RESULTS.where(last.inverted, RESULTS.inverted, RESULTS.diverged)
    failed = RESULTS.where(last.attempts >= newton.max_load_steps, RESULTS.step_limit, failed)
    result = RESULTS.where(last.reached >= 1.0, RESULTS.converged, failed)
    left = jnp.max(jnp.abs(unbalanced(body, rows, last.state)[: body.n_displacements]))
    return last.state, result, Stats(last.iterations, last.accepted, left)


@eqx.filter_custom_jvp
def _equilibrium(body: Body, rows: Array, force: Array, newton: Newton, start: State) -> Solution:
    return Solution(*_march(newton, body, rows, force, start))


@_equilibrium.def_jvp
def _equilibrium_jvp(primals, tangents):
    body, rows, force, newton, start = primals
    body_dot, rows_dot, force_dot, _, _ = tangents
    solution = _equilibrium(body, rows, force, newton, start)
    z, cells, pressed = solution.state.z, solution.state.cells, solution.state.pressed
    n, c, m = rows.shape
    rows_dot = jnp.zeros_like(rows) if rows_dot is None else rows_dot
    force_dot = jnp.zeros_like(force) if force_dot is None else force_dot

    def against(varied):
        return residual(varied, z)

    _, residual_dot = eqx.filter_jvp(against, (body,), (body_dot,))
    load_dot = jnp.einsum("ncm,cm->n", rows_dot, cells)
    if residual_dot is not None:  # None: the body is not varied
        load_dot = load_dot - residual_dot
    inverse = tangent_at(newton.linear, body, z)
    response = inverse(rows.reshape(n, c * m)).reshape(n, c, m)
    relaxed = inverse(load_dot[:, None])[:, 0]
    offset = jnp.einsum("ncm,n->cm", rows, relaxed) + jnp.einsum("ncm,n->cm", rows_dot, z)
    cells_dot, depth_dot = distribute_on(pressed, compliance_of(rows, response), offset, force_dot)
    z_dot = relaxed + jnp.einsum("ncm,cm->n", response, cells_dot)
    none = jax.tree.map(lambda _: None, solution)
    tangent = eqx.tree_at(
        lambda s: (s.state.z, s.state.cells, s.state.depth, s.stats.residual),
        none,
        (z_dot, cells_dot, depth_dot, jnp.zeros_like(solution.stats.residual)),
        is_leaf=lambda leaf: leaf is None,
    )
    return solution, tangent


def tangent_at(linear: AbstractLinearSolver, body: Body, z: Float[Array, " n"]):
    """K(z)⁻¹ by a factor of K(z) itself, as a differentiable map (`linear_solver.tangent_inverse`)."""
    factor = linear.factor(jax.lax.stop_gradient(element_tangents(*jax.lax.stop_gradient((body, z)))))
    return tangent_inverse(linear, factor, body, z, refinements=0)


def solve(
    newton: Newton, body: Body, rows: Float[Array, "n c m"], force: Float[Array, " c"], start: State
) -> Solution:
    """The equilibrium of a body under c contacts, by continuation of the contact forces from `start`.

    `rows` (n, c, m): `Contact.rows` of each contact; `force` (c,) [N]: their totals. Never raises:
    `Solution.result` says how it ended. Differentiable in body, rows and force by the implicit function
    theorem; start only says where to search.
    """
    return _equilibrium(body, rows, force, newton, start)
