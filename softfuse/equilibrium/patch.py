"""A patch of the surface that is pressed along its current normal.

The patch carries a frame: its mean position and two tangents, all linear in the nodes. Their cross product is
the current normal n into the body, and a contact of magnitude F pushes with f = F n. Such a force turns with
the body and has no potential; the law's derivative in the tangents makes up for that.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body
from softfuse.equilibrium.load import AbstractContact, AbstractLoad, LinearPorts, Sizes
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import PressureCells


def current_normal(frame: Float[Array, " 9"]) -> Float[Array, "3"]:
    """Unit normal into the body (3,) of a patch's frame (9,): position, first tangent, second tangent."""
    across = jnp.cross(frame[3:6], frame[6:9])
    return across / jnp.linalg.norm(across)


class NormalPatch(AbstractLoad):
    """A patch pressed with a given force along its current normal; its ports are those of its frame."""

    ports: LinearPorts

    @classmethod
    def of(cls, contact: Contact, body: Body) -> "NormalPatch":
        """The patch of a contact; its pressure is that of all cells together."""
        return cls(LinearPorts(*contact.frame(body)))

    @property
    def sizes(self):
        """The frame's nine ports; a force vector on the first three; the magnitude."""
        return Sizes(ports=9, forces=3, internal=0, drives=1)

    def start(self):
        """No force."""
        return jnp.zeros(3), jnp.zeros(0), jnp.zeros(1)

    def units(self):
        """Newtons."""
        return jnp.ones(3)

    def equations(self, force, internal, y, drive):
        """f − F n = 0 (3,) [N]."""
        del internal
        return force - drive[0] * current_normal(y)

    def conjugate(self, force, internal, y):
        """How far the patch has moved along its current normal (1,) [m]."""
        del force, internal
        return jnp.dot(y[:3] - self.ports.rest[:3], current_normal(y))[None]


class PatchContact(AbstractContact):
    """Patches at the middles `location` (e, 3) m of e electrodes, pressed along the inward directions (e, 3)
    and tangents (e, 2, 3) of their rest surface; a place is the number of an electrode.
    """

    faces: Int[Array, "f s"]
    location: Float[Array, "e 3"]
    direction: Float[Array, "e 3"]
    tangents: Float[Array, "e 2 3"]
    cells: PressureCells
    radius: Float[Array, ""]

    @classmethod
    def on(
        cls,
        faces: Int[Array, "f s"],
        location: Float[Array, "e 3"],
        direction: Float[Array, "e 3"],
        cells: PressureCells,
        radius: float,
    ) -> "PatchContact":
        """Patches on the outward faces (f, s) of a body; `direction` (e, 3): into it, of any length."""
        surfaces = [ContactSurface.pressed(faces, each) for each in direction]
        return cls(
            jnp.asarray(faces),
            jnp.asarray(location, float),
            jnp.stack([surface.direction for surface in surfaces]),
            jnp.stack([surface.tangents for surface in surfaces]),
            cells,
            jnp.asarray(radius, float),
        )

    def at(self, place: Int[Array, ""]) -> Contact:
        """The patch of electrode number `place`."""
        surface = ContactSurface(self.faces, self.direction[place], self.tangents[place])
        return Contact(surface, self.cells, self.location[place], self.radius)

    def load(self, body, place):
        """The patch of electrode number `place` as a load along its current normal."""
        return NormalPatch.of(self.at(place), body)
