"""The search for the equilibrium of one increment: Newton's method, or a flow to where a snap ends.

One iteration linearises the body, K δz = Σ f ∂y/∂z − r(z), lets the loads find their forces on the linearised
body (`interface`), by smooth laws to first order, and moves along δz. Stresses are unknowns of their own
between iterations (`AbstractBody.expecting`), which is why whole steps serve also where a slender body
turns by a right angle; a step is halved only where an element would lose nine tenths of its volume.

With a drag d > 0 it is the flow d M ẋ = Σ f ∂y/∂z − r of an overdamped body, M its `inertia`, by one linearly
implicit Euler step an iteration: (K + d M) δz = Σ f ∂y/∂z − r. The drag is lowered while steps are short and
the body gives way to what pushes it, and raised, the step taken back, where one is not. It leaves an
equilibrium that is not stable, and where it ends it is Newton's method (pseudo-transient continuation: Kelley
and Keyes, SIAM J. Numer. Anal. 35(2), 1998).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.mechanics.interface import slopes
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.linearised import coupled, linearise_beside, settled_on
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State

_SMALLEST_DAMPING = 1 / 64

_LEFT_OF_VOLUME = 0.1
"""What a step leaves of the volume at any quadrature point [-]."""

_FLAT = 1e-3
"""Volume over that at rest below which an element is as good as inside out [-]."""

_BALANCED = 1e-6
"""Part of what pushes a body that may be left out of balance: where elements become flat, stresses that are
unknowns of their own make steps short that are not near any equilibrium."""

_PATIENCE = 6
"""Iterations after which a step is shorter than the first, or the search is given up."""

_FLOW_ITERATIONS = 150

_FLOW_STEP = 0.05
"""Longest step of a flow, of the body's size."""

_NO_DRAG = 1e-9
"""Part of the first drag that is none."""


class Target(eqx.Module):
    """What an increment asks for: drives (D,), and how much more than in its start they and the work of
    gravity (n,) are.
    """

    drive: Float[Array, " D"]
    change: Float[Array, " D"]
    weight: Float[Array, " n"]


class Increment(eqx.Module):
    """A search on its way and at its end.

    `first`: its first step (n,), and the part of it that is due to the target's change; `along` (n,): what
    that change moves by the last tangent; `last` (n,): the step that led here; `left` [m]: its length before
    any damping, which says how far the equilibrium is; `drag` [N/m⁴].
    """

    state: State
    first: tuple[Float[Array, " n"], Float[Array, " n"]]
    along: Float[Array, " n"]
    last: Float[Array, " n"]
    left: Float[Array, ""]
    first_left: Float[Array, ""]
    drag: Float[Array, ""]
    damping: Float[Array, ""]
    count: Int[Array, ""]
    inverted: Bool[Array, ""]
    found: Bool[Array, ""]


def body_size(body: AbstractBody) -> Float[Array, ""]:
    """The longest extent [m] of a body at rest."""
    return jnp.max(jnp.max(body.rest, axis=0) - jnp.min(body.rest, axis=0))


def first_drag(body: AbstractBody) -> Float[Array, ""]:
    """A drag [N/m⁴] that resists every motion of a body more than it does itself in its softest ones."""
    return body.pressure_unit / body_size(body) ** 2


def search(
    linear: AbstractLinearSolver,
    body: AbstractBody,
    loads: Loads,
    start: State,
    target: Target,
    *,
    drag: Float[Array, ""],
    tolerance: float,
    max_iterations: int,
) -> Increment:
    """Search the equilibrium of a body, with its weight as the target has it, from a state: by Newton's
    method without `drag` [N/m⁴], else by a flow; `tolerance` [m] ends it.
    """
    flowing = drag > 0
    limit = jnp.where(flowing, _FLOW_ITERATIONS, max_iterations)

    def unfinished(at: Increment):
        closer = flowing | (at.count < _PATIENCE) | (at.left < at.first_left)
        alive = flowing | ((at.damping >= _SMALLEST_DAMPING) & ~jnp.isnan(at.left))
        return ~at.found & alive & closer & (at.count < limit)

    still, none = jnp.zeros(body.n), jnp.array(jnp.inf)
    start = eqx.tree_at(lambda s: s.drive, start, target.drive)
    first = Increment(
        start,
        (still, still),
        still,
        still,
        none,
        none,
        jnp.asarray(drag, float),
        jnp.array(1.0),
        jnp.array(0),
        jnp.array(False),
        jnp.array(False),
    )
    negligible = _NO_DRAG * first_drag(body)

    def iterate(at: Increment) -> Increment:
        return _iterate(linear.rough(), body, loads, target, at, tolerance, negligible)

    return jax.lax.while_loop(unfinished, iterate, first)


def _iterate(
    solver: AbstractLinearSolver,
    body: AbstractBody,
    loads: Loads,
    target: Target,
    at: Increment,
    tolerance: float,
    negligible: Float[Array, ""],
) -> Increment:
    # Each iteration solves only for what is out of balance, so that a rough factor serves.
    state, flowing = at.state, at.drag > 0
    tangents = body.expecting(state.z, at.last).element_tangents(state.z) + at.drag * body.inertia
    factor = solver.factor(loads.stiffen(body, state.z, state.force, tangents))
    linear, sagged = linearise_beside(
        body,
        loads,
        lambda b: solver.solve(factor, b),
        state,
        target.weight[:, None],
        around=state.internal,
    )
    settled, y = settled_on(linear, state)
    force = linear.held.force(settled.force, y)
    step = linear.step(settled.force)
    slope = slopes(linear.held, (settled.force, settled.internal), y, state.drive)
    system = coupled(loads, linear, slope)
    along, _ = system.respond(sagged, -(slope.drive @ target.change)[:, None])
    length = jnp.where(settled.found, jnp.max(jnp.abs(body.motion(step))), jnp.nan)

    def moved(damping):
        return State(
            state.z + damping * step,
            state.force + damping * (force - state.force),
            state.internal + damping * (settled.internal - state.internal),
            state.drive,
        )

    least = _LEFT_OF_VOLUME * body.volume_ratios(state.z)

    def crushed(damping):
        return ~jnp.all(body.volume_ratios(state.z + damping * step) > least)

    damping = jax.lax.while_loop(
        lambda damping: (damping >= _SMALLEST_DAMPING) & crushed(damping),
        lambda damping: damping / 2,
        jnp.array(1.0),
    )
    pushing = system.pushed @ (force - state.force) - linear.unbalanced
    # What a stable body gives way to does work on it.
    stable = (pushing * body.signs) @ step > 0
    largest = jnp.max(jnp.abs(jnp.append(system.pushed @ state.force, body.weight)))
    negligible_N = _BALANCED * largest + body.pressure_unit * body_size(body) * tolerance
    balanced = jnp.max(jnp.abs(linear.unbalanced)) <= negligible_N
    smooth = stable & (length <= _FLOW_STEP * body_size(body)) & (damping == 1.0)
    taken = jnp.where(flowing & ~smooth, 0.0, damping)
    drag = at.drag * jnp.where(smooth, 1 / 3, 8.0)
    after = moved(taken)
    return Increment(
        after,
        jax.tree.map(lambda new, old: jnp.where(at.count == 0, new, old), (step, along[:, 0]), at.first),
        along[:, 0],
        taken * step,
        length,
        jnp.where(at.count == 0, length, at.first_left),
        drag,
        damping,
        at.count + 1,
        (damping < 1.0) | (jnp.min(body.volume_ratios(after.z)) < _FLAT),
        # A step that was damped is not the last one, however short.
        (length <= tolerance) & (taken == 1.0) & (at.drag <= negligible) & balanced,
    )
