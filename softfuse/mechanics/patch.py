"""Patches of the surface that are pressed along their current normals.

A patch carries a frame: its mean position and two tangents, all linear in the nodes. Their cross product is
the current normal n into the body, and a contact of magnitude F pushes with f = F n. Such a force turns with
the body and has no potential; the law's derivative in the tangents makes up for that.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.contact import Contact
from softfuse.mechanics.load import AbstractLoad, Sizes
from softfuse.mechanics.surface_ports import PlacePorts


class NormalPatches(AbstractLoad):
    """c patches, each pressed with a given force along its current normal; ports are those of
    their frames.
    """

    ports: PlacePorts

    @classmethod
    def of(cls, contacts: Sequence[Contact], body: AbstractBody) -> "NormalPatches":
        """The patches of contacts; the pressure on each is that of all its cells together."""
        return cls(frame_ports(contacts, body))

    @property
    def sizes(self):
        """The frames' nine ports each; force vectors on the positions; the magnitudes."""
        c = self.ports.places
        return Sizes(ports=9 * c, forces=3 * c, internal=0, drives=c)

    def start(self):
        """No force."""
        sizes = self.sizes
        return jnp.zeros(sizes.forces), jnp.zeros(0), jnp.zeros(sizes.drives)

    def units(self):
        """Newtons."""
        return jnp.ones(self.sizes.forces)

    def equations(self, force, internal, y, drive):
        """f_j − F_j n_j = 0 (3 c,) [N]."""
        del internal
        return force - (drive[:, None] * _normals(y)).ravel()

    def conjugate(self, force, internal, y):
        """How far each patch has moved along its current normal (c,) [m]."""
        del force, internal
        moved = (y - self.ports.rest)[: self.sizes.forces].reshape(-1, 3)
        return jnp.sum(moved * _normals(y), axis=1)


class PatchForces(AbstractLoad):
    """c patches, each pushed with a force vector that is given in its current frame: along the normal into
    the body, and along its two tangents, of which the first follows that of the place.
    """

    ports: PlacePorts

    @property
    def sizes(self):
        """The frames' nine ports each; force vectors on the positions; as many drives."""
        c = self.ports.places
        return Sizes(ports=9 * c, forces=3 * c, internal=0, drives=3 * c)

    def start(self):
        """No force."""
        sizes = self.sizes
        return jnp.zeros(sizes.forces), jnp.zeros(0), jnp.zeros(sizes.drives)

    def units(self):
        """Newtons."""
        return jnp.ones(self.sizes.forces)

    def equations(self, force, internal, y, drive):
        """f_j − (F_n n + F_1 t_1 + F_2 t_2)_j = 0 (3 c,) [N]."""
        del internal
        return force - jnp.einsum("ck,cki->ci", drive.reshape(-1, 3), _axes(y)).ravel()

    def conjugate(self, force, internal, y):
        """How far each patch has moved along its current normal and tangents (3 c,) [m]."""
        del force, internal
        moved = (y - self.ports.rest)[: self.sizes.forces].reshape(-1, 3)
        return jnp.einsum("ci,cki->ck", moved, _axes(y)).ravel()


def frame_ports(contacts: Sequence[Contact], body: AbstractBody) -> PlacePorts:
    """Positions, then tangents, of the patches of contacts on a body."""
    rest, rows = zip(*(contact.frame(body) for contact in contacts), strict=True)
    return PlacePorts(
        _positions_first(jnp.stack(rest)), _positions_first(jnp.stack(rows, axis=1)), len(contacts)
    )


def _axes(y: Float[Array, " nine_c"]) -> Float[Array, "c 3 3"]:
    """Of each patch its normal n, its first tangent made a unit vector t_1, and t_2 = t_1 × n."""
    first = y[y.shape[0] // 3 :].reshape(-1, 2, 3)[:, 0]
    normal = _normals(y)
    first = first / jnp.linalg.norm(first, axis=1, keepdims=True)
    return jnp.stack([normal, first, jnp.cross(first, normal)], axis=1)


def _positions_first(frames: Float[Array, "... c 9"]) -> Float[Array, "... 9*c"]:
    """All positions, then all tangents, of frames that have both: forces belong to the first ports."""
    lead = frames.shape[:-2]
    return jnp.concatenate([frames[..., :3].reshape(*lead, -1), frames[..., 3:].reshape(*lead, -1)], axis=-1)


def _normals(y: Float[Array, " nine_c"]) -> Float[Array, "c 3"]:
    tangents = y[y.shape[0] // 3 :].reshape(-1, 2, 3)
    across = jnp.cross(tangents[:, 0], tangents[:, 1])
    return across / jnp.linalg.norm(across, axis=1, keepdims=True)
