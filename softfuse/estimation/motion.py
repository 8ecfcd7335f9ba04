"""How a robot's state moves: to equilibrium, with each drive, and with each contact's place.

At a state the body is linearised, the loads find their forces x on it at unchanged drives u (`interface`),
and the linear system around them,

    K δz − G_f δf = −(r(z) − G_f f) + ∂(G_f f)/∂p δp,    E_x δx + E_y Gᵀ δz + E_u δu + E_p δp = −E,

gives the equilibrium's correction at δu = δp = 0, and the sensitivities dz/du and dz/dp. The factor of K may
belong to an older tangent: refinements with the tangent's own action make up for it, and their first
contraction is returned so that the caller knows when a new factor pays. K has the stresses that the last step
expected (`AbstractBody.expecting`): a long step stretches a slender body to second order, and with the
stresses of that K would be far from the tangent of any equilibrium near. A second refinement is made only
where the first did not come close, and the correction is refined only where its error would be felt.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.functional.chart import moved
from softfuse.mechanics.held_loads import HeldLoads
from softfuse.mechanics.interface import slopes
from softfuse.mechanics.linear_solver import Solve
from softfuse.mechanics.linearised import Linearised, coupled, linearise, settled_on, stiffness_map
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State

_CLOSE = 0.15
"""A first refinement that is smaller than this part of the solution leaves an error of its square."""

_UNFELT = 1e-4
"""An error of the correction that is smaller than this part of the state is left to the next step."""


class Motion(NamedTuple):
    """`settled`: the state, corrected at unchanged drives and places; how body and loads move from there,
    `dz` (n, m) and `dx` (r, m), per unit of each drive, then per metre along each tangent of places; what was
    `unbalanced` (n,) before; and the `contraction` [-] of the first refinement.
    """

    settled: State
    dz: Float[Array, "n m"]
    dx: Float[Array, "r m"]
    unbalanced: Float[Array, " n"]
    contraction: Float[Array, ""]

    def after(self, change: Float[Array, " m"]) -> State:
        """The state after changes (m,) of drives and places."""
        drives = self.settled.drive.shape[0]
        moved = _moved(self.settled, self.dz @ change, self.dx @ change)
        return State(moved.z, moved.force, moved.internal, moved.drive + change[:drives])

    def derivative(self, of: Callable[[State], Float[Array, " k"]]) -> tuple[Array, Float[Array, "k m"]]:
        """A function of states at the settled one (k,), and its derivatives (k, m) along these motions."""
        q, drives = self.settled.force.shape[0], self.settled.drive.shape[0]
        value, linear = jax.linearize(of, self.settled)
        along = jax.vmap(lambda z, x: State(z, x[:q], x[q:], jnp.zeros(drives)), 1)(self.dz, self.dx)
        return value, jax.vmap(linear, 0, 1)(along)


def motion(
    model: Model,
    inverse: Solve,
    state: State,
    places: Array,
    *,
    by_place: Bool[Array, ""] | bool,
    refinements: int,
    last: Float[Array, " n"] | None = None,
    resistance: Float[Array, " n"] | None = None,
) -> Motion:
    """The motion of a state under contacts at places (c, 3, 3), with drives and, where asked for, `by_place`,
    with K⁻¹ as the map `inverse`, refined up to `refinements` times. `last` (n,): the step to that state,
    None where it is an equilibrium; `resistance` (n,): r(z), where known.

    Where `by_place` is an array, motions with places are there in any case, all 0 where it is false.
    """
    body, loads = model.body, model.loads(places)
    linear = linearise(body, loads, inverse, state, resistance)
    held = linear.held
    settled, y = settled_on(linear, state)
    x, q, drives = (settled.force, settled.internal), settled.force.shape[0], state.drive.shape[0]
    slope = slopes(held, x, y, state.drive)
    system = coupled(loads, linear, slope)
    pushed = system.pushed
    at = State(state.z, settled.force, settled.internal, state.drive)
    expecting = body if last is None else body.expecting(state.z, last)
    stiffness = stiffness_map(expecting, loads, at)

    def improving(load, law):
        def improve(dz, dx):
            left = load + pushed @ dx[:q] - stiffness(dz)
            return system.respond(inverse(left), law - slope.x @ dx - slope.y @ (linear.rows.T @ dz))

        return improve

    # The correction at unchanged drives, of which the body's part is known, and the sensitivities: drives
    # move the body through the laws only, places by themselves as well.
    load = pushed @ (settled.force - linear.force) - linear.unbalanced
    unmet = -(held.equations(*x, y, state.drive) + slope.y @ (held.at - y))[:, None]
    corrected = linear.step(settled.force)
    alone = jnp.zeros((body.n, 1 + drives)).at[:, 0].set(corrected)
    load_of, law_of = jnp.zeros((body.n, drives)), -slope.drive
    if by_place is not False:
        there = State(state.z + corrected, *x, state.drive)
        push, law = jax.lax.cond(
            by_place,
            lambda: _by_place(model, places, linear, there),
            lambda: (jnp.zeros((body.n, 2 * len(places))), jnp.zeros((len(unmet), 2 * len(places)))),
        )
        alone = jnp.concatenate([alone, inverse(push)], axis=1)
        load_of, law_of = (jnp.concatenate(both, axis=1) for both in ((load_of, push), (law_of, law)))
    dz, dx = system.respond(alone, jnp.concatenate([unmet, law_of], axis=1))
    turned = _refined((dz[:, 1:], dx[:, 1:]), improving(load_of, law_of), body.motion, refinements)
    moved, size = (jnp.linalg.norm(body.motion(each)) for each in (dz[:, :1], state.z))
    felt = ~(turned.contraction * moved <= _UNFELT * size)
    mending = improving(load[:, None], unmet)
    mended = _refined((dz[:, :1], dx[:, :1]), mending, body.motion, refinements, felt)
    contraction = jnp.maximum(turned.contraction, mended.contraction)

    def sprung(solved: _Solved) -> tuple[Float[Array, "n j"], Float[Array, "r j"]]:
        # Without what the springs carried.
        return solved.dz, solved.dx.at[:q].add(-loads.supports[:, None] * (pushed.T @ solved.dz))

    (dz, dx), sensitivity = sprung(mended), sprung(turned)
    return Motion(_moved(at, dz[:, 0], dx[:, 0]), *sensitivity, linear.unbalanced, contraction)


def _moved(state: State, dz: Float[Array, " n"], dx: Float[Array, " r"]) -> State:
    q = state.force.shape[0]
    return State(state.z + dz, state.force + dx[:q], state.internal + dx[q:], state.drive)


def _by_place(
    model: Model, places: Float[Array, "c 3 3"], linear: Linearised, settled: State
) -> tuple[Float[Array, "n 2*c"], Float[Array, "r 2*c"]]:
    """∂(G_f f)/∂p and −∂E/∂p of places along their tangents."""

    def loaded(along):
        loads = model.loads(moved(places, along))
        held, y = HeldLoads(loads, linear.held.at), loads.values(model.body, settled.z)
        law = held.equations(settled.force, settled.internal, y, settled.drive)
        return loads.push(model.body, settled.z, settled.force), -law

    push, law = jax.jacfwd(loaded)(jnp.zeros((len(places), 2)))
    return push.reshape(len(push), -1), law.reshape(len(law), -1)


class _Solved(NamedTuple):
    """Motions (n, j), changes of the loads' unknowns (r, j), and the first refinement's contraction."""

    dz: Float[Array, "n j"]
    dx: Float[Array, "r j"]
    contraction: Float[Array, ""]


def _refined(
    solved: tuple[Float[Array, "n j"], Float[Array, "r j"]],
    improve: Callable,
    motion: Callable,
    refinements: int,
    wanted: Bool[Array, ""] | bool = True,
) -> _Solved:
    """Up to so many refinements by `improve`, (dz, dx) ↦ (ddz, ddx): the first where it is `wanted`, others
    only where that was not close; `motion` of unknowns is what norms are taken of.
    """

    def refine(at: _Solved, first: Array) -> _Solved:
        ddz, ddx = improve(at.dz, at.dx)
        size, change = (jnp.linalg.norm(motion(each), axis=0) for each in (at.dz, ddz))
        contraction = jnp.where(first, jnp.max(change / (size + 1e-12)), at.contraction)
        return _Solved(at.dz + ddz, at.dx + ddx, contraction)

    def next_one(at: _Solved, first: Array) -> tuple[_Solved, None]:
        # Not `>=`: a contraction that is no number goes on, and stays none.
        close = jnp.where(first, jnp.logical_not(wanted), at.contraction < _CLOSE)
        return jax.lax.cond(close, lambda at, _: at, refine, at, first), None

    # A loop, so that the solve, the largest part of the step's program, is compiled once for all of them.
    return jax.lax.scan(next_one, _Solved(*solved, jnp.zeros(())), jnp.arange(refinements) == 0)[0]
