"""Enclosed volumes as ports: their conjugate forces are the gauge pressures inside.

A pressure follows the surface: its nodal forces p ∂V/∂z turn with it, which adds −p ∂²V/∂z² to the tangent,
face by face and therefore within the elements that the faces belong to. Of an open cavity that holds while
the apex of its cap does not move, so its rim has to be held, as the fitting of a tube holds it.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity, cone_volume
from softfuse.mechanics.load import AbstractPorts


class VolumePorts(AbstractPorts):
    """The volumes of cavities (p,) [m³], and the elements that the faces of each belong to."""

    cavities: tuple[Cavity, ...]
    elements: tuple[Int[Array, "_"], ...]

    @classmethod
    def of(cls, cavities: tuple[Cavity, ...], body: AbstractBody) -> "VolumePorts":
        """The cavities of a body. Raises MeshError when a face belongs to none of its elements, or the rim of
        an open cavity can move.
        """
        for cavity in cavities:
            _check_rim(cavity, body)
        return cls(cavities, tuple(_owners(np.asarray(cavity.faces), body) for cavity in cavities))

    def values(self, body, z):
        """Enclosed volumes (p,) [m³]."""
        positions = body.rest + body.watched(z)
        return jnp.stack([cavity(positions) for cavity in self.cavities])

    def rows(self, body, z):
        """∂V/∂z (n, p) [m²]."""
        return jax.jacrev(lambda x: self.values(body, x))(z).T

    def stiffen(self, body, z, force, tangents):
        """Minus Σ p ∂²V/∂z² for pressures `force` (p,) [Pa]."""
        positions = body.rest + body.watched(z)
        for cavity, element, pressure in zip(self.cavities, self.elements, force, strict=True):
            s = cavity.faces.shape[1]
            bend = jax.vmap(jax.hessian(cone_volume))(positions[cavity.faces] - cavity.apex(positions))
            bend = bend.reshape(-1, 3 * s, 3 * s)
            tangents = body.stiffened(tangents, element, cavity.faces, -pressure * bend)
        return tangents

    @property
    def supports(self):
        """No springs."""
        return jnp.zeros(len(self.cavities))

    def resultants(self, body, z):
        """What the pressures on all faces amount to (6, p): nothing, on a closed surface."""
        positions = body.rest + body.watched(z)

        def moved(motion: Float[Array, "6"]) -> Float[Array, " p"]:
            rigid = positions + motion[:3] + jnp.cross(motion[3:], positions)
            return jnp.stack([cavity(rigid) for cavity in self.cavities])

        return jax.jacfwd(moved)(jnp.zeros(6)).T


def _check_rim(cavity: Cavity, body: AbstractBody) -> None:
    pulls = jnp.broadcast_to(jnp.eye(3), (*cavity.rim.shape, 3, 3))
    if cavity.rim.size and bool(jnp.any(body.spread(cavity.rim, pulls))):
        middle = np.asarray(body.rest)[np.asarray(cavity.rim)].mean(axis=0)
        raise MeshError(
            f"the rim of the cavity that opens at {(1e3 * middle).round(2).tolist()} mm can move, so that "
            "gas under pressure has nothing to hold its cap: hold the rim, as the fitting of a tube does, or "
            "close the cavity"
        )


def _owners(faces: Int[np.ndarray, "f s"], body: AbstractBody) -> Int[Array, " f"]:
    tets = np.asarray(body.tets)
    corners = tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]]
    owner = {tuple(key): e for e, four in enumerate(np.sort(corners, axis=2)) for key in four}
    element = np.array([owner.get(tuple(key), -1) for key in np.sort(faces[:, :3], axis=1)])
    if np.any(element < 0):
        raise MeshError("a cavity has a face that belongs to no element: take its faces from the body's mesh")
    return jnp.asarray(element, jnp.int32)
