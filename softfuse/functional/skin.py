"""The body's surface as something to press on anywhere: places, each with a frame of its own.

A place is (3, 3), see `functional.chart`: a point of the surface [m], and unit tangents u, v there, whose
cross product is the outward normal; d = −u × v points into the body. Normals vary smoothly from face to face,
as means at the corners that are interpolated in between, except over creases, whose two sides keep their own.
What lands along d is sought among the faces near the place: with a direction that varies, no table can name
them beforehand.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from softfuse.errors import MeshError
from softfuse.functional.chart import direction_of
from softfuse.functional.contact import ContactSurface
from softfuse.functional.face_search import EveryFace
from softfuse.mesh.nearest import nearest_on_triangles

_CREASE = np.cos(np.radians(35.0))
"""Cosine between faces that meet at a crease. Facets of a coarse dome meet at less."""

_SAME_SIDE = 0.3
"""Cosine between directions of places that count as neighbours: on a thin body not the other side."""

_FINER = 4
"""So many times closer than the places of a spread are those that they are chosen from."""


class Skin(eqx.Module):
    """Outward faces (f, 3) or (f, 6), outward unit normals (f, 3, 3) at their corners, and how many of them
    may be `near` a place.
    """

    faces: Int[Array, "f s"]
    normals: Float[Array, "f 3 3"]
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
        return cls(jnp.asarray(faces), jnp.asarray(_corner_normals(rest, faces)), most)

    def around(self, rest: Float[Array, "k 3"], place: Float[Array, "3 3"]) -> ContactSurface:
        """The faces near a place, pressed along its direction, of nodes at `rest` (k, 3) m."""
        surface, _ = self._around(rest, place, place[0])
        return surface

    def _around(
        self, rest: Float[Array, "k 3"], place: Float[Array, "3 3"], point: Float[Array, "3"]
    ) -> tuple[ContactSurface, Int[Array, " n"]]:
        corners = jax.lax.stop_gradient(rest[self.faces[:, :3]])
        middles = jnp.mean(corners, axis=1)
        size = jnp.max(jnp.linalg.norm(corners - middles[:, None], axis=2), axis=1)
        apart = jnp.linalg.norm(middles - jax.lax.stop_gradient(point), axis=1) - size
        near = jnp.sort(jax.lax.top_k(-apart, self.near)[1])
        # Their cross product is the direction, that of the place its outward normal.
        tangents = jnp.stack([place[1], -place[2]])
        return ContactSurface(self.faces[near], direction_of(place), tangents, EveryFace(self.near)), near

    def moved(
        self, rest: Float[Array, "k 3"], place: Float[Array, "3 3"], offset: Float[Array, "2"]
    ) -> tuple[Float[Array, "3 3"], Bool[Array, ""]]:
        """The place (3, 3) that is `offset` (2,) m further along u and v, and whether there is one.

        It is carried along d onto the surface of nodes at `rest` (k, 3) m; its frame is the old one turned
        over to the normal there. Differentiable in place and offset. Where d meets no surface, beyond an
        edge, the place stays.
        """
        target = place[0] + offset @ place[1:]
        surface, near = self._around(rest, place, target)
        seen = surface.seen(rest)
        on = surface.land_on(seen, target[None])
        point = on.shape[0] @ rest[on.nodes[0]]
        # The face is that with these nodes: the barycentric coordinates of its corners weigh its normals.
        number = jnp.argmax(jnp.all(surface.faces == on.nodes[0], axis=1))
        triangle = seen.corners[number]
        flat = jnp.linalg.solve((triangle[1:] - triangle[0]).T, target @ surface.tangents.T - triangle[0])
        weights = jnp.concatenate([1 - jnp.sum(flat, keepdims=True), flat])
        inwards = -weights @ self.normals[near[number]]
        turned = framed(point, inwards / jnp.linalg.norm(inwards), place[1])
        return jnp.where(on.met[0], turned, place), on.met[0]

    def places_at(
        self, rest: Float[np.ndarray, "k 3"], points: Float[np.ndarray, "p 3"], *, along: Sequence[float]
    ) -> Float[np.ndarray, "p 3 3"]:
        """The places of the surface nearest to points (p, 3) m; u is the direction `along` (3,), or where the
        surface is across that the next axis, as far as it is tangential.
        """
        corners = np.asarray(rest)[np.asarray(self.faces)[:, :3]]
        found = nearest_on_triangles(np.asarray(points, float).reshape(-1, 3), corners)
        at = np.einsum("pk,pki->pi", found.barycentric, corners[found.triangle])
        return self._with_frames(at, found.triangle, found.barycentric, along)

    def spread(
        self,
        rest: Float[np.ndarray, "k 3"],
        spacing: float,
        *,
        along: Sequence[float],
        within: Bool[np.ndarray, " f"] | None = None,
    ) -> Float[np.ndarray, "p 3 3"]:
        """Places about `spacing` [m] from each other all over the faces (f,) `within`, or over all of them;
        the same for the same surface. Raises MeshError without a face.
        """
        chosen = np.arange(len(self.faces)) if within is None else np.flatnonzero(within)
        if not len(chosen):
            raise MeshError("no face of the surface lies within the region of contacts: enlarge it")
        corners = np.asarray(rest)[np.asarray(self.faces)[:, :3]]
        face, weights = [], []
        for number in chosen:
            edges = corners[number] - np.roll(corners[number], 1, axis=0)
            n = max(1, int(np.ceil(_FINER * np.linalg.norm(edges, axis=1).max() / spacing)))
            weights.append(_middles(n))
            face.append(np.full(n * n, number))
        numbers, inside = np.concatenate(face), np.concatenate(weights)
        at = np.einsum("pk,pki->pi", inside, corners[numbers])
        places = self._with_frames(at, numbers, inside, along)
        return places[_apart(places, spacing)]

    def _with_frames(
        self,
        at: Float[np.ndarray, "p 3"],
        face: Int[np.ndarray, " p"],
        weights: Float[np.ndarray, "p 3"],
        along: Sequence[float],
    ) -> Float[np.ndarray, "p 3 3"]:
        inwards = -np.einsum("pk,pki->pi", weights, np.asarray(self.normals)[face])
        inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
        wished = np.asarray(along, float) / np.linalg.norm(along)
        other = np.roll(np.eye(3)[np.argmax(np.abs(wished))], 1)
        first = np.where(np.abs(inwards @ wished)[:, None] < 0.9, wished, other)
        u = first - inwards * np.sum(first * inwards, axis=1, keepdims=True)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        return np.stack([at, u, np.cross(u, inwards)], axis=1)


def framed(
    point: Float[Array, "3"], inwards: Float[Array, "3"], along: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """The place at a point (3,) m with a unit direction into the body (3,), whose u is `along` (3,) as far as
    that is tangential.
    """
    u = along - inwards * jnp.dot(along, inwards)
    u = u / jnp.linalg.norm(u)
    return jnp.stack([point, u, jnp.cross(u, inwards)])


def neighbours(places: Float[np.ndarray, "p 3 3"], distance: float) -> list[Int[np.ndarray, " n"]]:
    """For each place the others within a `distance` [m] that face the same side, in ascending order."""
    near = KDTree(places[:, 0]).query_ball_point(places[:, 0], distance, return_sorted=True)
    outwards = np.cross(places[:, 1], places[:, 2])
    found = []
    for k, numbers in enumerate(near):
        others = np.setdiff1d(np.asarray(numbers, int), [k])
        found.append(others[outwards[others] @ outwards[k] > _SAME_SIDE])
    return found


def _middles(n: int) -> Float[np.ndarray, "nn 3"]:
    """Barycentric middles (n², 3) of the triangles into which n cuts a side divide a triangle."""
    i, j = (each.ravel() for each in np.mgrid[:n, :n])
    upright = np.stack([i, j], axis=1)[i + j < n] + 1 / 3
    turned = np.stack([i, j], axis=1)[i + j < n - 1] + 2 / 3
    two = np.concatenate([upright, turned]) / n
    return np.column_stack([two, 1 - two.sum(axis=1)])


def _apart(places: Float[np.ndarray, "p 3 3"], spacing: float) -> Int[np.ndarray, " n"]:
    """Numbers of places none of which is nearer to another on its side than about a spacing, and none of
    which could be added.
    """
    # At 0.8 spacings such sets have one spacing between neighbours in the mean.
    around = neighbours(places, 0.8 * spacing)
    left, kept = np.ones(len(places), bool), []
    for k in np.random.default_rng(0).permutation(len(places)):
        if left[k]:
            kept.append(k)
            left[around[k]] = False
    return np.sort(np.array(kept))


def _corner_normals(rest: Float[np.ndarray, "k 3"], faces: Int[np.ndarray, "f s"]) -> np.ndarray:
    """Outward unit normals (f, 3, 3) at the faces' corners: means over the faces around that no crease parts,
    each weighted by its angle there.
    """
    corners = rest[faces[:, :3]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = np.all(edges[order][1:] == edges[order][:-1], axis=1)
    pairs = np.stack([order[:-1][same], order[1:][same]]) // 3
    smooth = np.sum(normal[pairs[0]] * normal[pairs[1]], axis=1) > _CREASE
    joined = coo_array((np.ones(smooth.sum()), pairs[:, smooth]), shape=(len(faces), len(faces)))
    _, group = connected_components(joined, directed=False)
    towards = [np.roll(corners, -k, axis=1) - corners for k in (1, 2)]
    cosine = np.sum(towards[0] * towards[1], axis=2) / np.prod(np.linalg.norm(towards, axis=3), axis=0)
    angle = np.arccos(np.clip(cosine, -1, 1))
    _, meeting = np.unique(faces[:, :3].astype(np.int64) * len(faces) + group[:, None], return_inverse=True)
    total = np.zeros((meeting.max() + 1, 3))
    np.add.at(total, meeting.ravel(), (angle[:, :, None] * normal[:, None]).reshape(-1, 3))
    found = total[meeting.reshape(-1, 3)]
    return found / np.linalg.norm(found, axis=2, keepdims=True)
