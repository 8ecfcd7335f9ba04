"""Where the middle of a contact may be: a part of the surface, with places to look at all over it."""

from abc import abstractmethod
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from softfuse.errors import MeshError
from softfuse.functional.chart import FlatChart
from softfuse.mesh.nearest import nearest_on_triangles

Within = Callable[[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]], Bool[np.ndarray, " n"]]
"""Which points (n, 3) m of a surface with outward unit normals (n, 3) are meant."""

_CREASE = np.cos(np.radians(35.0))
"""Cosine between faces that meet at a crease. Facets of a coarse dome meet at less."""

_CANDIDATES = 40
"""Points that are drawn for each place of a surface, of which those far apart are kept."""


class AbstractWorkspace(eqx.Module):
    """A part of the surface."""

    @abstractmethod
    def room(
        self, places: Float[np.ndarray, "c 3 3"]
    ) -> tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, "c 2"]]:
        """How far along its tangents each place (c, 3, 3) may move, at least and at most (c, 2) [m]."""

    @abstractmethod
    def grid(self, side: int) -> tuple[Float[np.ndarray, "s 3 3"], Float[np.ndarray, "2"]]:
        """Places (s, 3, 3) all over it, side² if it has sides, and their pitch along tangents (2,) [m]."""

    @abstractmethod
    def drawn(self, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
        """A place (3, 3) at random."""

    @property
    @abstractmethod
    def extent_m(self) -> Float[np.ndarray, "2"]:
        """The standard deviation (2,) [m] of a place along its tangents that may be anywhere."""

    @abstractmethod
    def landed(self, places: Float[np.ndarray, "c 3 3"]) -> Float[np.ndarray, "c 3 3"]:
        """Places (c, 3, 3) that have moved along their tangents, back on the surface, with its tangents."""


class FlatWorkspace(AbstractWorkspace):
    """A rectangle of a flat chart, from the coordinates `low` (2,) to `high` (2,) [m]."""

    chart: FlatChart
    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]

    def room(self, places):
        """To the edges of the rectangle."""
        at = self.chart.coordinates(places)
        # Tangents are along or against the axes. In numpy: this is asked in every frame.
        axes = np.asarray(self.chart.axes)
        along = axes @ np.stack([axes[0], np.cross(axes[0], np.asarray(self.chart.direction))]).T
        ends = np.stack([(self.low - at) @ along, (self.high - at) @ along])
        return ends.min(axis=0), ends.max(axis=0)

    def grid(self, side):
        """A grid of side x side places up to the edges."""
        x, y = np.meshgrid(*np.linspace(self.low, self.high, side).T, indexing="ij")
        pitch = (self.high - self.low) / (side - 1)
        return np.asarray(self.chart.place(jnp.stack([x.ravel(), y.ravel()], axis=1))), pitch

    def drawn(self, rng):
        """Anywhere in the rectangle."""
        return np.asarray(self.chart.place(jnp.asarray(rng.uniform(self.low, self.high))))

    @property
    def extent_m(self):
        """That of an even spread over the rectangle."""
        return (self.high - self.low) / np.sqrt(12.0)

    def landed(self, places):
        """Where they are."""
        return places


class SurfaceWorkspace(AbstractWorkspace):
    """A part of a triangulated surface: places (s, 3, 3) some `spacing` [m] apart all over it.

    `corners` (f, 3, 3) m of its triangles and unit normals (f, 3, 3) at these, see `corner_normals`.
    """

    corners: Float[np.ndarray, "f 3 3"]
    normals: Float[np.ndarray, "f 3 3"]
    places: Float[np.ndarray, "s 3 3"]
    spacing: float

    @classmethod
    def over(
        cls,
        rest: Float[np.ndarray, "k 3"],
        faces: Int[np.ndarray, "f c"],
        within: Within,
        spacing: float,
    ) -> "SurfaceWorkspace":
        """Of the part of outward faces (f, 3 or 6) of nodes at `rest` (k, 3) m whose points are meant.

        Raises MeshError when no point is.
        """
        corners = np.asarray(rest)[np.asarray(faces)[:, :3]]
        normals = corner_normals(rest, faces)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(across, axis=1)
        # The same places whenever the same surface is looked at.
        random = np.random.default_rng(0)
        count = max(_CANDIDATES, int(_CANDIDATES * area.sum() / spacing**2))
        face = random.choice(len(area), count, p=area / area.sum())
        points, facing = _weighed(random.dirichlet(np.ones(3), count), corners[face], normals[face])
        kept = within(points, facing)
        if not kept.any():
            raise MeshError("no part of the outer surface is in these ranges: widen them")
        points, facing = points[kept], facing[kept]
        chosen = spread_out(points, spacing=spacing)
        places = framed(points[chosen], facing[chosen])
        return cls(corners, normals, places, float(spacing))

    def room(self, places):
        """A spacing to each side: then it is looked at anew."""
        reach = np.full((len(places), 2), self.spacing)
        return -reach, reach

    def grid(self, side):
        """Its places."""
        del side
        return self.places, np.full(2, self.spacing)

    def drawn(self, rng):
        """One of its places."""
        return self.places[rng.integers(len(self.places))]

    @property
    def extent_m(self):
        """That of its places, the same to both sides."""
        apart = self.places[:, 0] - self.places[:, 0].mean(axis=0)
        return np.full(2, np.sqrt(np.mean(np.sum(apart**2, axis=1)) / 2))

    def landed(self, places):
        """The nearest points of the surface."""
        return _nearest(places[:, 0], self.corners, self.normals)


def nearest_places(
    rest: Float[np.ndarray, "k 3"], faces: Int[np.ndarray, "f c"], points: Float[np.ndarray, "p 3"]
) -> Float[np.ndarray, "p 3 3"]:
    """The places (p, 3, 3) nearest to points (p, 3) m, of outward faces (f, 3 or 6) of nodes at `rest` (k, 3)
    m.
    """
    corners = np.asarray(rest)[np.asarray(faces)[:, :3]]
    return _nearest(np.asarray(points, float).reshape(-1, 3), corners, corner_normals(rest, faces))


def corner_normals(
    rest: Float[np.ndarray, "k 3"], faces: Int[np.ndarray, "f c"]
) -> Float[np.ndarray, "f 3 3"]:
    """Outward unit normals (f, 3, 3) at the corners of faces (f, 3 or 6) of nodes at `rest` (k, 3) m.

    Each is the mean over the faces around, weighted by their angles there, which makes normals vary from face
    to face as those of the smooth surface that they stand for do; over a crease, each side has its own.
    """
    triangles = np.asarray(faces)[:, :3].astype(np.int64)
    corners = np.asarray(rest)[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = np.all(edges[order][1:] == edges[order][:-1], axis=1)
    pairs = np.stack([order[:-1][same], order[1:][same]]) // 3
    smooth = np.sum(normal[pairs[0]] * normal[pairs[1]], axis=1) > _CREASE
    joined = coo_array((np.ones(smooth.sum()), pairs[:, smooth]), shape=(len(triangles), len(triangles)))
    _, group = connected_components(joined, directed=False)
    towards = [np.roll(corners, -k, axis=1) - corners for k in (1, 2)]
    cosine = np.sum(towards[0] * towards[1], axis=2) / np.prod(np.linalg.norm(towards, axis=3), axis=0)
    angle = np.arccos(np.clip(cosine, -1, 1))
    _, meeting = np.unique(triangles * len(triangles) + group[:, None], return_inverse=True)
    total = np.zeros((meeting.max() + 1, 3))
    np.add.at(total, meeting.ravel(), (angle[:, :, None] * normal[:, None]).reshape(-1, 3))
    return _unit(total[meeting.reshape(-1, 3)])


def _nearest(points: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> Float[np.ndarray, "p 3 3"]:
    found = nearest_on_triangles(points, corners)
    return framed(*_weighed(found.barycentric, corners[found.triangle], normals[found.triangle]))


def _weighed(
    weights: Float[np.ndarray, "n 3"],
    corners: Float[np.ndarray, "n 3 3"],
    normals: Float[np.ndarray, "n 3 3"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points (n, 3) m and unit normals (n, 3) at barycentric coordinates (n, 3) of triangles."""
    points, across = (np.einsum("nk,nki->ni", weights, each) for each in (corners, normals))
    return points, _unit(across)


def _unit(vectors: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def framed(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Places (n, 3, 3) at points (n, 3) m with outward unit normals (n, 3), the first tangent across that of
    x, y, z which is most across the normal.
    """
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    u = _unit(axis - normals * np.sum(axis * normals, axis=1, keepdims=True))
    return np.stack([points, u, np.cross(normals, u)], axis=1)


def spread_out(
    points: Float[np.ndarray, "n 3"], *, spacing: float = 0.0, most: int | None = None
) -> Int[np.ndarray, " s"]:
    """Numbers (s,) of points (n, 3) m, each furthest from those before, until all are within a spacing, or
    there are so many; the first is the first.
    """
    chosen = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while away.max() > spacing and len(chosen) != most:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)
