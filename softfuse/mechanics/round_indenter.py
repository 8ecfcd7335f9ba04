"""A rigid sphere or cylinder that is pressed into a body: frictionless, no tension, no penetration.

Ports are the mean positions x_k of the pressure cells of a disc that lands where the contact may be; which of
them touch is part of the solution. The indenter's middle c moves along d by its depth. With the part ρ_k of
x_k − c across the cylinder's axis (all of it, for a sphere) and the gap s_k = |ρ_k| − R + v_k, v_k what the
mean of |ρ| over the cell at rest is above its value at the mean position, a cell is pushed by f_k = λ_k
ρ_k/|ρ_k|, 0 ≤ λ_k ⊥ s_k ≥ 0. Driven by force, Σ d · f_k = F determines the depth, which counts from where the
indenter first touches the body at rest. Cells slide over the indenter, so that large depths are exact too.
Source of what it is checked against: Johnson, Contact Mechanics, 1985, ch. 4.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.contact import Contact
from softfuse.mechanics.load import AbstractLoad, Sizes
from softfuse.mechanics.surface_ports import PlacePorts

_WEIGHT = 1e-9  # N, as of a punch
_SOFTENING = 1e-10  # of 1/γ: cells that a coarse mesh cannot tell apart share their force


class Round(eqx.Module):
    """The shape: its `middle` (3,) m at first touch, the unit vector d (3,) along which it moves, the
    projection `across` (3, 3) onto directions across its axis, its radius R [m], and of each cell v (m,) [m]
    and whether it is over the body `met` (m,).
    """

    middle: Float[Array, "3"]
    direction: Float[Array, "3"]
    across: Float[Array, "3 3"]
    radius: Float[Array, ""]
    spread: Float[Array, " m"]
    met: Bool[Array, " m"]

    def gaps(
        self, y: Float[Array, " three_m"], depth: Float[Array, ""]
    ) -> tuple[Float[Array, " m"], Float[Array, "m 3"]]:
        """Gaps s (m,) [m] at a depth [m], and the directions (m, 3) in which cells are pushed."""
        away = (y.reshape(-1, 3) - self.middle - depth * self.direction) @ self.across
        apart = jnp.linalg.norm(away, axis=1)
        return apart - self.radius + self.spread, away / apart[:, None]


class RoundIndenter(AbstractLoad):
    """The indenter under a prescribed force along d; γ `stiffness` [N/m] weighs gaps against forces."""

    ports: PlacePorts
    shape: Round
    stiffness: Float[Array, ""]

    @classmethod
    def of(
        cls, contact: Contact, body: AbstractBody, radius: Float[Array, ""], axis: Float[Array, "2"]
    ) -> "RoundIndenter":
        """A sphere of `radius` [m] over a contact's disc, whose cells it may touch; or a cylinder along the
        `axis` (2,) in the disc's tangents, 0 for a sphere.
        """
        surface, cells = contact.surface, contact.cells
        on = contact.landed(body)
        each = jnp.einsum("ps,psi->pi", on.shape, body.rest[on.nodes])

        def over_cells(values):
            weights = contact.shares(on).reshape(-1, *[1] * (values.ndim - 1))
            return jnp.zeros((cells.count, *values.shape[1:])).at[cells.cell].add(weights * values)

        line = axis @ surface.tangents
        across = jnp.eye(3) - jnp.outer(line, line)
        middle = contact.location - radius * surface.direction
        # Each point is touched at its own depth; the first of them counts.
        lateral = (each - middle) @ (across - jnp.outer(surface.direction, surface.direction))
        under = jnp.sqrt(jnp.maximum(radius**2 - jnp.sum(lateral**2, axis=1), 0.0))
        touched = (each - middle) @ surface.direction - under
        middle = middle + jnp.min(jnp.where(on.met, touched, jnp.inf)) * surface.direction
        rest = over_cells(each)
        apart = jnp.linalg.norm((each - middle) @ across, axis=1)
        spread = over_cells(apart) - jnp.linalg.norm((rest - middle) @ across, axis=1)
        met = jnp.zeros(cells.count).at[cells.cell].add(1.0 * on.met) > 0
        column = jnp.eye(cells.count)[cells.cell]
        unit = jnp.einsum("ps,pm,ij->psimj", contact.parts(on), column, jnp.eye(3))
        rows = body.spread(on.nodes, unit.reshape(*on.nodes.shape, 3, -1))
        # Of a cell that meets nothing no position is known.
        rest = jnp.where(met[:, None], rest, middle - radius * surface.direction)
        shape = Round(middle, surface.direction, across, radius, spread, met)
        gamma = jax.lax.stop_gradient(body.pressure_unit * contact.radius)
        return cls(PlacePorts(rest.ravel(), rows, cells.count), shape, gamma)

    def at_depth(self) -> "RoundIndenterAtDepth":
        """The same indenter, driven by its depth."""
        return RoundIndenterAtDepth(self.ports, self.shape, self.stiffness)

    @property
    def sizes(self):
        """Positions and forces of m cells; their magnitudes and the depth; the total force."""
        m = self.ports.places
        return Sizes(ports=3 * m, forces=3 * m, internal=m + 1, drives=1)

    def start(self):
        """No force, no depth."""
        sizes = self.sizes
        return jnp.zeros(sizes.forces), jnp.zeros(sizes.internal), jnp.zeros(1)

    def units(self):
        """Forces in N, the depth in F/γ of 1 N."""
        sizes = self.sizes
        return jnp.append(jnp.ones(sizes.forces + sizes.internal - 1), 1 / self.stiffness)

    def equations(self, force, internal, y, drive):
        """f − λ n = 0 (3 m,), γ s = 0 or λ = 0 (m,), then Σ d · f − F = 0 [N]."""
        push, depth = internal[:-1], internal[-1]
        gap, normal = self.shape.gaps(y, depth)
        v = jnp.where(self.shape.met, push - self.stiffness * gap, -jnp.inf)
        # One cell always is on, or nothing would hold the indenter.
        on = (v > 0) | (v >= jnp.max(v))
        law = jnp.where(on, self.stiffness * gap + _SOFTENING * push, push)
        total = jnp.sum(force.reshape(-1, 3) @ self.shape.direction) - drive[0] - _WEIGHT
        return jnp.concatenate([force - (push[:, None] * normal).ravel(), law, total[None]])

    def conjugate(self, force, internal, y):
        """The depth (1,) [m]."""
        del force, y
        return internal[-1:]


class RoundIndenterAtDepth(AbstractLoad):
    """The indenter at a prescribed depth [m]; above the body it rests on nothing."""

    ports: PlacePorts
    shape: Round
    stiffness: Float[Array, ""]

    @property
    def sizes(self):
        """Positions and forces of m cells; their magnitudes; the depth."""
        m = self.ports.places
        return Sizes(ports=3 * m, forces=3 * m, internal=m, drives=1)

    def start(self):
        """No force, no depth."""
        sizes = self.sizes
        return jnp.zeros(sizes.forces), jnp.zeros(sizes.internal), jnp.zeros(1)

    def units(self):
        """Forces in N."""
        sizes = self.sizes
        return jnp.ones(sizes.forces + sizes.internal)

    def equations(self, force, internal, y, drive):
        """f − λ n = 0 (3 m,), then γ s = 0 or λ = 0 (m,) [N]."""
        gap, normal = self.shape.gaps(y, drive[0])
        gap = self.stiffness * gap
        on = self.shape.met & (internal - gap > 0)
        law = jnp.where(on, gap + _SOFTENING * internal, internal)
        return jnp.concatenate([force - (internal[:, None] * normal).ravel(), law])

    def conjugate(self, force, internal, y):
        """The force (1,) [N] along d that moves the indenter."""
        del internal, y
        return jnp.sum(force.reshape(-1, 3) @ self.shape.direction, keepdims=True)
