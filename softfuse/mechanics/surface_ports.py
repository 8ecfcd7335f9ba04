"""What contacts push on: displacements of a disc's cells along one direction, or positions of places.

Both are linear in the body's unknowns. Where their forces act in the body's current shape, held nodes
included, gives their resultants.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.functional.contact import Contact
from softfuse.mechanics.load import AbstractLinearPorts, force_resultants


class CellPorts(AbstractLinearPorts):
    """The displacements (m,) [m] of cells along a unit `direction` (3,), counted from the gaps `rest` (m,)
    under them; rows `slopes` (n, m). Each point (p,) of a `cell` rests on `nodes` (p, s) by its parts
    `share` (p, s) of the cell's force.
    """

    rest: Float[Array, " m"]
    slopes: Float[Array, "n m"]
    direction: Float[Array, "3"]
    nodes: Int[Array, "p s"]
    share: Float[Array, "p s"]
    cell: Int[Array, " p"]

    @classmethod
    def of(cls, contact: Contact, body: AbstractBody) -> "CellPorts":
        """The cells of a flat disc on a body."""
        on = contact.landed(body)
        parts, surface, cells = contact.parts(on), contact.surface, contact.cells
        rows = body.spread_along(surface.direction, on.nodes, parts, cells.cell, cells.count)
        return cls(contact.heights(on, body.rest), rows, surface.direction, on.nodes, parts, cells.cell)

    def resultants(self, body, z):
        """The direction at the mean of the cell's points (6, m)."""
        x = (body.rest + body.watched(z))[self.nodes]
        empty = jnp.zeros(self.rest.shape)
        force = empty.at[self.cell].add(jnp.sum(self.share, axis=1))[:, None] * self.direction
        first = jnp.zeros((len(empty), 3)).at[self.cell].add(jnp.einsum("ps,psi->pi", self.share, x))
        return jnp.concatenate([force, jnp.cross(first, self.direction)], axis=1).T


class PlacePorts(AbstractLinearPorts):
    """x, y, z [m] of places, one after the other, then perhaps others that carry no force: `rest` (p,),
    `slopes` (n, p); so many `places`.
    """

    rest: Float[Array, " p"]
    slopes: Float[Array, "n p"]
    places: int = eqx.field(static=True)

    def resultants(self, body, z):
        """Unit forces along the axes at the places (6, p), none at the others."""
        count = 3 * self.places
        at = self.values(body, z)[:count].reshape(-1, 3)
        return jnp.pad(force_resultants(at), ((0, 0), (0, self.rest.shape[0] - count)))
