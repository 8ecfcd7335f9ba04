"""The body's surface as something to press on anywhere.

A place is (3, 3), see `functional.chart`: a point of the surface [m], and unit tangents u, v there, whose
cross product is the outward normal; d = −u × v points into the body. What lands along d is sought among the
faces near the place: with a direction that varies, no table can name them beforehand.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree

from softfuse.functional.chart import direction_of
from softfuse.functional.contact import ContactSurface, EveryFace


class Skin(eqx.Module):
    """Outward faces (f, 3) or (f, 6), and how many of them may be `near` a place."""

    faces: Int[Array, "f s"]
    near: int = eqx.field(static=True)

    @classmethod
    def of(cls, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"], reach: float) -> "Skin":
        """The skin of outward faces (f, s) of nodes at `rest` (k, 3) m.

        `reach` [m]: how far from a place something may land that is carried along its direction; for a disc
        of radius a on a surface that is not bent more sharply, 1.5 a.
        """
        rest, faces = np.asarray(rest), np.asarray(faces)
        corners = rest[faces[:, :3]]
        middles = corners.mean(axis=1)
        size = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
        # A place is at most a face's size from a middle; corners stand for all places.
        tree, most = KDTree(middles), 1
        for inner in np.array_split(np.concatenate([middles, rest[np.unique(faces[:, :3])]]), 16):
            for point, numbers in zip(
                inner, tree.query_ball_point(inner, reach + 2 * size.max()), strict=True
            ):
                apart = np.linalg.norm(middles[numbers] - point, axis=1) - 2 * size[numbers]
                most = max(most, int(np.sum(apart <= reach)))
        return cls(jnp.asarray(faces), most)

    def around(self, rest: Float[Array, "k 3"], place: Float[Array, "3 3"]) -> ContactSurface:
        """The faces near a place, pressed along its direction, of nodes at `rest` (k, 3) m."""
        corners = jax.lax.stop_gradient(rest[self.faces[:, :3]])
        middles = jnp.mean(corners, axis=1)
        size = jnp.max(jnp.linalg.norm(corners - middles[:, None], axis=2), axis=1)
        apart = jnp.linalg.norm(middles - jax.lax.stop_gradient(place[0]), axis=1) - size
        near = jnp.sort(jax.lax.top_k(-apart, self.near)[1])
        # Their cross product is the direction, that of the place its outward normal.
        tangents = jnp.stack([place[1], -place[2]])
        return ContactSurface(self.faces[near], direction_of(place), tangents, EveryFace(self.near))
