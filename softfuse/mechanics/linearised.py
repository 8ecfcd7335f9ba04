"""A body and its loads, linearised at a state: K δz = G f − r, y = y(z) + Gᵀδz, and E(x, y, u) = 0 around
forces and internal unknowns x that obey it. K holds the springs of supported ports, f is f̃ (`HeldLoads`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody, column_by_column
from softfuse.mechanics.held_loads import HeldLoads
from softfuse.mechanics.interface import Settled, Slopes, settle, stiffness
from softfuse.mechanics.linear_solver import Solve
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State


def unbalanced(body: AbstractBody, loads: Loads, state: State) -> Float[Array, " n"]:
    """r(z) − Σ f ∂y/∂z (n,): what is left of the equilibrium equations."""
    return body.residual(state.z) - loads.push(body, state.z, state.force)


def loaded_tangents(body: AbstractBody, loads: Loads, state: State) -> Float[Array, "e d d"]:
    """Element tangents (e, d, d) of the body with its loads at constant forces."""
    return loads.stiffen(body, state.z, state.force, body.element_tangents(state.z))


def stiffness_map(body: AbstractBody, loads: Loads, state: State) -> Solve:
    """The tangent stiffness at constant forces, with the supports, as the map of directions (n, c):
    linearised once, never formed.
    """

    of_body = body.tangent_action(state.z)
    _, of_loads = jax.linearize(lambda z: loads.push(body, z, state.force), state.z)
    supported = loads.rows(body, state.z)[:, loads.carrying]

    def applied(directions: Float[Array, "n c"]) -> Float[Array, "n c"]:
        springs = supported @ (loads.supports[:, None] * (supported.T @ directions))
        return of_body(directions) - column_by_column(of_loads, directions) + springs

    return applied


class Linearised(eqx.Module):
    """What the loads, `held`, see of a body under forces f₀ (Q,), those it was linearised at.

    `unbalanced` (n,): r − G_f f₀, what is left of its balance; `rows` G (n, P); `response` K⁻¹G_f (n, Q) to a
    unit of each force; `relaxed` (n,): −K⁻¹(r − G_f f₀), the motion at unchanged forces; and from these the
    ports' values y₀ (P,) without forces and their compliance S (P, Q). Only what is out of balance is solved
    for, so that the error of an inexact K⁻¹ vanishes with it.
    """

    held: HeldLoads
    force: Float[Array, " Q"]
    unbalanced: Float[Array, " n"]
    rows: Float[Array, "n P"]
    response: Float[Array, "n Q"]
    relaxed: Float[Array, " n"]
    free: Float[Array, " P"]
    compliance: Float[Array, "P Q"]

    def step(self, force: Float[Array, " Q"]) -> Float[Array, " n"]:
        """δz (n,) under forces (Q,)."""
        return self.relaxed + self.response @ (force - self.force)


def linearise(
    body: AbstractBody,
    loads: Loads,
    inverse: Solve,
    state: State,
    resistance: Float[Array, " n"] | None = None,
) -> Linearised:
    """Linearise at a state with K⁻¹ as the map `inverse`; `resistance` (n,): r(z), where it is known."""
    return linearise_beside(body, loads, inverse, state, jnp.zeros((body.n, 0)), resistance)[0]


def linearise_beside(
    body: AbstractBody,
    loads: Loads,
    inverse: Solve,
    state: State,
    beside: Float[Array, "n c"],
    resistance: Float[Array, " n"] | None = None,
    *,
    around: Float[Array, " M"] | None = None,
) -> tuple[Linearised, Float[Array, "n c"]]:
    """As `linearise`; and K⁻¹ `beside` (n, c), which is solved for along with it; `around` (M,): see
    `HeldLoads`.
    """
    rows = loads.rows(body, state.z)
    pushed = rows[:, loads.carrying]
    resistance = body.residual(state.z) if resistance is None else resistance
    left = resistance - pushed @ state.force
    solved = inverse(jnp.concatenate([beside, pushed, left[:, None]], axis=1))
    c = beside.shape[1]
    response, relaxed = solved[:, c:-1], -solved[:, -1]
    at = loads.values(body, state.z)
    compliance = rows.T @ response
    free = at + rows.T @ relaxed - compliance @ state.force
    held = HeldLoads(loads, at, around)
    linear = Linearised(held, state.force, left, rows, response, relaxed, free, compliance)
    return linear, solved[:, :c]


def touched(
    body: AbstractBody,
    loads: Loads,
    state: State,
    untouched: Linearised,
    rows: Float[Array, "n p"],
    response: Float[Array, "n q"],
) -> Linearised:
    """The body and loads linearised at a state: those of an `untouched` body and before them a contact
    without force, of which `rows` (n, p) and `response` (n, q) are known. Nothing is solved for.
    """
    at = loads.values(body, state.z)
    compliance = jnp.block(
        [
            [rows.T @ response, rows.T @ untouched.response],
            [untouched.rows.T @ response, untouched.compliance],
        ]
    )
    relaxed = untouched.relaxed
    all_rows = jnp.concatenate([rows, untouched.rows], axis=1)
    return Linearised(
        HeldLoads(loads, at),
        state.force,
        untouched.unbalanced,
        all_rows,
        jnp.concatenate([response, untouched.response], axis=1),
        relaxed,
        at + all_rows.T @ relaxed - compliance @ state.force,
        compliance,
    )


def settled_on(linear: Linearised, state: State) -> tuple[Settled, Float[Array, " P"]]:
    """Forces f̃ and internal unknowns that obey the loads' laws on the linearised body, at a state's drives
    and searched from its unknowns; and the ports' values y (P,) under them.
    """
    found = settle(linear.held, linear.free, linear.compliance, state.drive, (state.force, state.internal))
    return found, linear.free + linear.compliance @ found.force


class Coupled(eqx.Module):
    """Body and laws linearised together, as one linear system for motions and the loads' unknowns."""

    linear: Linearised
    slope: Slopes
    pushed: Float[Array, "n Q"]
    whole: Float[Array, "r r"]

    def respond(
        self, alone: Float[Array, "n j"], law: Float[Array, "r j"]
    ) -> tuple[Float[Array, "n j"], Float[Array, "r j"]]:
        """Solve K δz − G_f δf = K alone, E_x δx + E_y Gᵀδz = law (r, j) for δz (n, j), δx (r, j), `alone` (n,
        j) being how the body would move without the loads' answer.
        """
        dx = jnp.linalg.solve(self.whole, law - self.slope.y @ (self.linear.rows.T @ alone))
        return alone + self.linear.response @ dx[: self.pushed.shape[1]], dx


def coupled(loads: Loads, linear: Linearised, slope: Slopes) -> Coupled:
    """The system of a linearised body and the laws' slopes there."""
    pushed = linear.rows[:, loads.carrying]
    return Coupled(linear, slope, pushed, stiffness(slope, linear.compliance))
