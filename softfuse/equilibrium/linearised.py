"""A body and its loads, linearised at a state: K δz = G f − r, y = y(z) + Gᵀδz, and E(x, y, u) = 0 around
forces and internal unknowns x that obey it. K holds the springs of supported ports, f is f̃ (`HeldLoads`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.body import Body, element_tangents, residual
from softfuse.equilibrium.interface import Slopes, stiffness
from softfuse.equilibrium.linear_solver import Solve
from softfuse.equilibrium.load import HeldLoads, Loads
from softfuse.equilibrium.solution import State


def unbalanced(body: Body, loads: Loads, state: State) -> Float[Array, " n"]:
    """r(z) − Σ f ∂y/∂z (n,): what is left of the equilibrium equations."""
    return residual(body, state.z) - loads.push(body, state.z, state.force)


def loaded_tangents(body: Body, loads: Loads, state: State) -> Float[Array, "e d d"]:
    """Element tangents (e, d, d) of the body with its loads at constant forces."""
    return loads.stiffen(body, state.z, state.force, element_tangents(body, state.z))


def stiffness_action(body: Body, loads: Loads, state: State, directions: Float[Array, "n c"]) -> Array:
    """The tangent stiffness at constant forces, with the supports, applied to c directions (n, c) without
    forming it.
    """

    def balance(z):
        return residual(body, z) - loads.push(body, z, state.force)

    _, action = jax.linearize(balance, state.z)
    supported = loads.rows(body, state.z)[:, loads.carrying]
    springs = supported @ (loads.supports[:, None] * (supported.T @ directions))
    return jax.vmap(action, 1, 1)(directions) + springs


class Linearised(eqx.Module):
    """What the loads, `held`, see of a body: its residual r (n,), rows G (n, P), the response K⁻¹G_f (n, Q)
    to a unit of each force, the motion without forces −K⁻¹r (n,), and from these the ports' free values y₀
    (P,) and compliance S (P, Q).
    """

    held: HeldLoads
    residual: Float[Array, " n"]
    rows: Float[Array, "n P"]
    response: Float[Array, "n Q"]
    relaxed: Float[Array, " n"]
    free: Float[Array, " P"]
    compliance: Float[Array, "P Q"]

    def step(self, force: Float[Array, " Q"]) -> Float[Array, " n"]:
        """δz (n,) under forces (Q,)."""
        return self.relaxed + self.response @ force


def linearise(body: Body, loads: Loads, inverse: Solve, z: Float[Array, " n"]) -> Linearised:
    """Linearise at z (n,) with K⁻¹ as the map `inverse`."""
    rows = loads.rows(body, z)
    pushed = rows[:, loads.carrying]
    left = residual(body, z)
    solved = inverse(jnp.concatenate([pushed, left[:, None]], axis=1))
    response, relaxed = solved[:, :-1], -solved[:, -1]
    at = loads.values(body, z)
    free = at + rows.T @ relaxed
    return Linearised(HeldLoads(loads, at), left, rows, response, relaxed, free, rows.T @ response)


class Coupled(eqx.Module):
    """Body and laws linearised together, as one linear system for motions and the loads' unknowns."""

    linear: Linearised
    slope: Slopes
    pushed: Float[Array, "n Q"]
    whole: Float[Array, "r r"]

    def respond(
        self, inverse: Solve, load: Float[Array, "n j"], law: Float[Array, "r j"]
    ) -> tuple[Float[Array, "n j"], Float[Array, "r j"]]:
        """Solve K δz − G_f δf = load (n, j), E_x δx + E_y Gᵀδz = law (r, j) for δz (n, j), δx (r, j)."""
        alone = inverse(load)
        dx = jnp.linalg.solve(self.whole, law - self.slope.y @ (self.linear.rows.T @ alone))
        return alone + self.linear.response @ dx[: self.pushed.shape[1]], dx


def coupled(loads: Loads, linear: Linearised, slope: Slopes) -> Coupled:
    """The system of a linearised body and the laws' slopes there."""
    pushed = linear.rows[:, loads.carrying]
    return Coupled(linear, slope, pushed, stiffness(slope, linear.compliance))
