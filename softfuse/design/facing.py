"""How far opposite walls of a cavity are apart: from each node of a wall straight across to the other side.

From a node at X with unit normal n into the cavity, the ray X + t n leaves through a triangle of the wall;
the point there, weights w of its corners, is a material point. Its distance along n when the body has moved
by u,

    g = n · (Σ w (X + u) − X_node − u_node),

is 0 where the walls touch. Rays by M. Möller, B. Trumbore, J. Graphics Tools 2(1), 1997, DOI
10.1080/10867651.1997.10487468.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

_SAME = 1e-9
"""Cosine of the angle between a ray and a triangle, and weight of a corner, that rounding makes of 0."""

_ACROSS = 0.5
"""Cosine of the angle of normals on both sides from which on they count as opposite."""


class Facing(eqx.Module):
    """m pairs of a node (m,) and a point opposite: corners (m, 3) of its triangle, weights (m, 3) [-], and
    the unit normals (m, 3) from the node to it.
    """

    node: Int[Array, " m"]
    corners: Int[Array, "m 3"]
    weights: Float[Array, "m 3"]
    normal: Float[Array, "m 3"]

    @classmethod
    def of(cls, nodes: Float[np.ndarray, "n 3"], walls: Sequence[Int[np.ndarray, "_ c"]]) -> "Facing":
        """The pairs on the walls of cavities, faces (f, 3 or more) of nodes (n, 3) m with normals into the
        material: as many as walls have nodes, some of them repeated for nodes that face nothing, so that
        meshes with the same faces have as many.
        """
        parts = [_across(nodes, np.asarray(faces)[:, :3]) for faces in walls]
        return cls(*(jnp.asarray(np.concatenate(each)) for each in zip(*parts, strict=True)))

    def gaps(self, positions: Float[Array, "n 3"]) -> Float[Array, " m"]:
        """Distances (m,) [m] of the pairs at positions (n, 3) m of all nodes; differentiable, and linear: of
        small motions they are the changes.
        """
        opposite = jnp.einsum("mk,mki->mi", self.weights, positions[self.corners])
        return jnp.sum(self.normal * (opposite - positions[self.node]), axis=1)


def _across(
    nodes: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    corner = nodes[faces]
    along, up = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.cross(along, up)
    normals = np.zeros_like(nodes)
    np.add.at(normals, faces.ravel(), np.repeat(area, 3, axis=0))
    own = np.unique(faces)
    inwards = -normals[own] / np.linalg.norm(normals[own], axis=1, keepdims=True)
    # All rays (r, 1) with all triangles (1, f).
    p = np.cross(inwards[:, None], up[None])
    size = np.einsum("fi,rfi->rf", along, p)
    flat = np.abs(size) < _SAME * np.linalg.norm(area, axis=1)
    scale = 1.0 / np.where(flat, 1.0, size)
    begin = nodes[own][:, None] - corner[None, :, 0]
    first = scale * np.einsum("rfi,rfi->rf", begin, p)
    q = np.cross(begin, along[None])
    second = scale * np.einsum("ri,rfi->rf", inwards, q)
    distance = scale * np.einsum("fi,rfi->rf", up, q)
    opposite = inwards @ (area / np.linalg.norm(area, axis=1, keepdims=True)).T > _ACROSS
    own_face = (faces[None] == own[:, None, None]).any(axis=2)
    inside = (first >= -_SAME) & (second >= -_SAME) & (first + second <= 1.0 + _SAME)
    met = np.where(inside & opposite & ~flat & ~own_face & (distance > 0.0), distance, np.inf)
    hit = np.argmin(met, axis=1)
    ray = np.flatnonzero(np.isfinite(met[np.arange(len(own)), hit]))
    if len(ray) > 0:
        ray = np.resize(ray, len(own))
    face = hit[ray]
    a, b = first[ray, face], second[ray, face]
    return own[ray], faces[face], np.stack([1.0 - a - b, a, b], axis=1), inwards[ray]
