"""Points and places of a body that its nodes carry along, as numbers outside of programs."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from softfuse.body.base import AbstractBody
from softfuse.functional.chart import direction_of
from softfuse.functional.contact import ContactSurface
from softfuse.functional.material_points import MaterialPoints
from softfuse.sensors.parts import TrueContact


@dataclass(frozen=True, eq=False)
class Carried:
    """Points that move with the body: shape values (g, a) on its nodes (g, a)."""

    nodes: Int[np.ndarray, "g a"]
    shape: Float[np.ndarray, "g a"]

    @classmethod
    def of(cls, body: AbstractBody, points: Float[np.ndarray, "g 3"]) -> "Carried":
        """Points at rest positions (g, 3) m. Raises MeshError for a point outside the body."""
        embedded = MaterialPoints.embedded(body, points)
        if not len(points):
            return cls(np.zeros((0, 1), int), np.zeros((0, 1)))
        return cls(np.asarray(embedded.nodes), np.asarray(embedded.shape(body.rest)))

    def at(self, nodes: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "g 3"]:
        """Their positions (g, 3) m at node positions (k, 3) m."""
        return np.einsum("ga,gai->gi", self.shape, nodes[self.nodes])


@dataclass(frozen=True, eq=False)
class Skin:
    """The surface at a `place` (3, 3), see `functional.chart`: nodes (s,), shape values (s,), and their
    slopes (s, 2) [1/m] along its tangents.
    """

    place: Float[np.ndarray, "3 3"]
    nodes: Int[np.ndarray, " s"]
    shape: Float[np.ndarray, " s"]
    slopes: Float[np.ndarray, "s 2"]

    @classmethod
    def under(
        cls, body: AbstractBody, faces: Int[np.ndarray, "f s"], place: Float[np.ndarray, "3 3"]
    ) -> "Skin":
        """Of the outward faces (f, s) of a body at a place (3, 3)."""
        surface = ContactSurface.pressed(faces, np.asarray(direction_of(jnp.asarray(place))))
        on = surface.land(body.rest, jnp.asarray(place[:1]))
        return cls(place, *(np.asarray(each[0]) for each in (on.nodes, on.shape, on.slopes)))

    def touched(
        self, nodes: Float[np.ndarray, "k 3"], gap: float, force: float, radius: float
    ) -> TrueContact:
        """A ball of a radius [m] that lies on the surface as nodes at (k, 3) m make it, or hovers over it."""
        tangents = self.slopes.T @ nodes[self.nodes]
        inward = np.cross(*tangents)
        inward /= np.linalg.norm(inward)
        middle = self.shape @ nodes[self.nodes] - (radius + max(gap, 0.0)) * inward
        return TrueContact(self.place, gap, force, radius, middle)
