"""A disc pressed onto a body's surface: the displacement under each of its pressure cells.

The disc of radius a stands over the location c, perpendicular to the pressing direction d; each of its
quadrature points is carried along d onto the outermost face it meets, at rest. Cell k has the functional g_k
= Σ_i s_ik d · u(x_i), the mean displacement [m] under it, linear in u; its conjugate is the cell's force [N],
which acts in the direction d. The points move with the disc, not with the mesh: g_k is continuous and
piecewise smooth in the location and needs no mesh that knows the disc. Points beyond the body's edge carry
nothing: a cell's force is on those that meet it. A flat disc that is moved along d first touches the highest
point under it; the height of every other cell below that is its gap at rest.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.shape import linear, quadratic
from softfuse.functional.chart import across
from softfuse.functional.pressure_cells import PressureCells
from softfuse.material.base import constant

# In mean sizes of a face. On a regular mesh squares of twice the width have twice as many faces near.
_WIDTH, _MARGIN = 0.125, 0.25

_GRAZING = 0.1  # cosine below which a face is seen edge-on
_NOWHERE = 1.0  # m: the gap under a cell that no part of the surface is under


class AbstractFaceSearch(eqx.Module):
    """Names those of a surface's f faces that points of the plane across its direction may lie over.

    The surface tests each of them: a search can miss a face, but not invent one. `EveryFace` misses none and
    is the definition; `FaceBuckets` names a few and finds the same.
    """

    @abstractmethod
    def candidates(self, points: Float[Array, "p 2"]) -> Int[Array, "#p c"]:
        """Numbers (p, c) of faces among which are all that lie over each point (p, 2) m, these in ascending
        order; some may come twice. (1, c) where they are the same for all points.
        """


class EveryFace(AbstractFaceSearch):
    """All `count` faces: where there are few, or where the direction is known only in the computation."""

    count: int = eqx.field(static=True)

    def candidates(self, points):
        """All of them (1, f)."""
        del points
        return jnp.arange(self.count)[None]


class FaceBuckets(AbstractFaceSearch):
    """The faces near the square of a grid that a point lies in.

    `faces` (a, b, c): those that come closer to each square than a margin; `low` (2,) m: where the grid
    begins; `width` [m]: of a square. The grid is made for nodes at rest. It still finds every face while no
    corner has moved across the direction by more than the margin, a quarter of a face's mean size, which is
    the root of the mean area seen along the direction. A rest shape that differs by more needs a new one.
    """

    faces: Int[Array, "a b c"]
    low: Float[Array, "2"]
    width: Float[Array, ""]

    @classmethod
    def over(cls, triangles: Float[np.ndarray, "f 3 2"]) -> "FaceBuckets":
        """The grid over the faces' corners (f, 3, 2) m, seen along the direction."""
        edges = np.roll(triangles, -1, axis=1) - triangles
        size = np.sqrt(np.mean(np.abs(_cross(edges[:, 0], edges[:, 1]))) / 2)
        width, margin = _WIDTH * size, _MARGIN * size
        low, high = triangles.min(axis=(0, 1)) - margin, triangles.max(axis=(0, 1)) + margin
        squares = np.ceil((high - low) / width).astype(int)
        near = [_squares_near((triangle - low) / width, margin / width, squares) for triangle in triangles]
        table = _by_square(near, int(squares.prod())).reshape(*squares, -1)
        return cls(jnp.asarray(table), jnp.asarray(low), jnp.asarray(width))

    def candidates(self, points):
        """Those of each point's square (p, c); beyond the grid, of the nearest one."""
        last = jnp.array(self.faces.shape[:2]) - 1
        square = jnp.clip(jnp.floor((points - self.low) / self.width).astype(int), 0, last)
        return self.faces[square[:, 0], square[:, 1]]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _squares_near(
    triangle: Float[np.ndarray, "3 2"], margin: float, squares: Int[np.ndarray, "2"]
) -> Int[np.ndarray, " n"]:
    """Row-major numbers of the unit squares of a grid (a, b) that, widened by the margin, touch a triangle.

    Convex shapes are apart when they are along the normal of a side of one of them.
    """
    first = np.maximum(np.floor(triangle.min(axis=0) - margin).astype(int), 0)
    last = np.minimum(np.floor(triangle.max(axis=0) + margin).astype(int), squares - 1)
    i, j = (each.ravel() for each in np.mgrid[first[0] : last[0] + 1, first[1] : last[1] + 1])
    middles = np.stack([i, j], axis=1) + 0.5
    touched = np.ones(len(middles), bool)
    for side in np.roll(triangle, -1, axis=0) - triangle:
        reach = (0.5 + margin) * np.abs(side).sum()
        place, span = _cross(side, middles), _cross(side, triangle)
        touched &= (place >= span.min() - reach) & (place <= span.max() + reach)
    return (i * squares[1] + j)[touched]


def _by_square(near: list[Int[np.ndarray, " _"]], squares: int) -> Int[np.ndarray, "q c"]:
    """The faces of each square in ascending order, from the squares near each face.

    To be as many everywhere the last one is repeated; squares without any name one that is elsewhere.
    """
    square = np.concatenate(near)
    order = np.argsort(square, kind="stable")
    face = np.repeat(np.arange(len(near), dtype=np.int32), [len(each) for each in near])[order]
    count = np.bincount(square, minlength=squares)
    own = np.minimum(np.arange(count.max()), np.maximum(count - 1, 0)[:, None])
    return face[np.minimum((np.cumsum(count) - count)[:, None] + own, len(face) - 1)]


class Landed(eqx.Module):
    """Where points meet a surface: nodes (p, s) of the face, shape values (p, s), their slopes (p, s, 2)
    [1/m] along the surface's tangents, and whether the point meets it at all (p,).
    """

    nodes: Int[Array, "p s"]
    shape: Float[Array, "p s"]
    slopes: Float[Array, "p s 2"]
    met: Bool[Array, " p"]


class SeenFaces(eqx.Module):
    """A surface's faces seen along the direction: corners (f, 3, 2) m across it; what a point is tested with
    (f, 7), first corner, barycentric slopes and height; and the number of one that faces the disc.
    """

    corners: Float[Array, "f 3 2"]
    test: Float[Array, "f 7"]
    one: Int[Array, ""]


class ContactSurface(eqx.Module):
    """Faces (f, 3) or (f, 6) that can be pressed along the unit vector `direction` (3,), unit tangents (2, 3)
    across it, whose cross product it is, and how the faces under a point are found.
    """

    faces: Int[Array, "f s"]
    direction: Float[Array, "3"]
    tangents: Float[Array, "2 3"]
    search: AbstractFaceSearch

    @classmethod
    def pressed(cls, faces: Int[np.ndarray, "f s"], direction: Float[np.ndarray, "3"]) -> "ContactSurface":
        """Outward faces (f, s) pressed along a direction (3,) of any length, each point tested on all."""
        d, tangents = _axes(direction)
        return cls(jnp.asarray(faces), jnp.asarray(d), jnp.asarray(tangents), EveryFace(len(faces)))

    @classmethod
    def facing(
        cls, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"], direction: Float[np.ndarray, "3"]
    ) -> "ContactSurface":
        """Those of the outward faces (f, s) of nodes at `rest` (k, 3) m that look against the direction (3,):
        the only ones that points can land on, and each point tested on those near it (`FaceBuckets`).
        """
        d, tangents = _axes(direction)
        corner = np.asarray(rest)[np.asarray(faces)[:, :3]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        seen = normal @ d < -_GRAZING * np.linalg.norm(normal, axis=1)
        search = FaceBuckets.over(corner[seen] @ tangents.T)
        return cls(jnp.asarray(faces[seen]), jnp.asarray(d), jnp.asarray(tangents), search)

    def around(self, rest: Float[Array, "k 3"], place: Float[Array, "3 3"]) -> "ContactSurface":
        """The faces near a place (3, 3): all of them, along the one direction; see `Skin.around`."""
        del rest, place
        return self

    def land(self, rest: Float[Array, "k 3"], points: Float[Array, "p 3"]) -> Landed:
        """Where points (p, 3) m meet the surface of nodes at `rest` (k, 3) m along the direction.

        Differentiable in both, on the faces that they meet; how far `rest` may be from where the surface was
        made for is up to its search.
        """
        return self.land_on(self.seen(rest), points)

    def seen(self, rest: Float[Array, "k 3"]) -> SeenFaces:
        """The faces of nodes at `rest` (k, 3) m."""
        corners = rest[self.faces[:, :3]]
        flat = corners @ self.tangents.T
        corners, across = jax.lax.stop_gradient((corners, flat))
        normal = jnp.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = normal @ self.direction < -_GRAZING * jnp.linalg.norm(normal, axis=1)
        # A face seen edge-on has no barycentric coordinates: any other triangle in its place does.
        shown = jnp.where(facing[:, None, None], across, jnp.eye(3, 2))
        height = jnp.where(facing, jnp.mean(corners @ self.direction, axis=1), jnp.inf)
        # In one table, so that what the test of a candidate needs is fetched together.
        test = jnp.concatenate([shown[:, 0], _slopes(shown).reshape(-1, 4), height[:, None]], axis=1)
        return SeenFaces(flat, test, jnp.argmax(facing))

    def land_on(self, seen: SeenFaces, points: Float[Array, "p 3"]) -> Landed:
        """Where points (p, 3) m meet faces that are seen, see `land`."""
        flat, target = seen.corners, points @ self.tangents.T
        face, met = self._outermost(seen, jax.lax.stop_gradient(target))
        values = linear if self.faces.shape[1] == 3 else quadratic

        def shape_at(place, triangle):
            return values(jnp.stack(_barycentric(place - triangle[0], _slopes(triangle))))

        shape = jax.vmap(shape_at)(target, flat[face])
        slopes = jax.vmap(jax.jacfwd(shape_at))(target, flat[face])
        return Landed(self.faces[face], shape, slopes, met)

    def _outermost(
        self, seen: SeenFaces, target: Float[Array, "p 2"]
    ) -> tuple[Int[Array, " p"], Bool[Array, " p"]]:
        """The face (p,) that the disc meets first of those in line with each point, and whether there is one;
        where there is none, one that faces the disc.
        """
        candidate = self.search.candidates(target)
        corner, slopes, height = jnp.split(seen.test[candidate], [2, 6], axis=-1)
        first, second, third = _barycentric(target[:, None] - corner, slopes.reshape(*slopes.shape[:2], 2, 2))
        inside = jnp.minimum(first, jnp.minimum(second, third)) >= -1e-9
        height = jnp.where(inside, height[..., 0], jnp.inf)
        met = jnp.any(height < jnp.inf, axis=1)
        lowest = jnp.argmin(height, axis=1)[:, None]
        face = jnp.take_along_axis(jnp.broadcast_to(candidate, height.shape), lowest, axis=1)[:, 0]
        return jnp.where(met, face, seen.one), met


def _axes(direction: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "2 3"]]:
    """The unit vector of a direction (3,), and unit tangents (2, 3) across it whose cross product it is."""
    d, first = across(direction)
    return d, np.stack([first, np.cross(d, first)])


def _slopes(triangle: Float[Array, "... 3 2"]) -> Float[Array, "... 2 2"]:
    """Gradients (..., 2, 2) [1/m] of the barycentric coordinates of the second and third corner."""
    (x2, y2), (x3, y3) = (jnp.moveaxis(triangle[..., k, :] - triangle[..., 0, :], -1, 0) for k in (1, 2))
    twice = x2 * y3 - y2 * x3
    return jnp.stack([jnp.stack([y3, -x3], -1), jnp.stack([-y2, x2], -1)], -2) / twice[..., None, None]


def _barycentric(
    offset: Float[Array, "... 2"], slopes: Float[Array, "... 2 2"]
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """The three barycentric coordinates at an offset (..., 2) m from the first corner."""
    x, y = offset[..., 0], offset[..., 1]
    second, third = (slopes[..., k, 0] * x + slopes[..., k, 1] * y for k in (0, 1))
    return 1 - second - third, second, third


class Contact(eqx.Module):
    """A disc of `radius` (m) that presses at `location` (3,) m of its centre, with the pressure cells it may
    have, through a layer of `compliance` [m/Pa] that each cell compresses for itself.
    """

    surface: ContactSurface
    cells: PressureCells
    location: Float[Array, "3"]
    radius: Float[Array, ""]
    compliance: Float[Array, ""] = eqx.field(default=0.0, converter=constant)

    @property
    def areas(self) -> Float[Array, " m"]:
        """The cells' areas (m,) [m²]."""
        return self.radius**2 * self.cells.area

    @property
    def points(self) -> Float[Array, "p 3"]:
        """The quadrature points (p, 3) m."""
        return self.location + self.radius * (self.cells.points @ self.surface.tangents)

    def landed(self, body: AbstractBody) -> Landed:
        """Where the quadrature points meet the body at rest."""
        return self.surface.land(body.rest, self.points)

    def shares(self, on: Landed) -> Float[Array, " p"]:
        """The parts (p,) [-] of a newton in a point's cell that are carried where the points landed: they sum
        to 1 in every cell, or to 0 in one that meets nothing.
        """
        share, total = jnp.where(on.met, self.cells.share, 0.0), self._over_cells(on.met * self.cells.share)
        return share / jnp.where(total > 0, total, 1.0)[self.cells.cell]

    def parts(self, on: Landed) -> Float[Array, "p s"]:
        """The parts (p, s) [-] of a newton in a point's cell that the nodes carry where the points landed."""
        return self.shares(on)[:, None] * on.shape

    def heights(self, on: Landed, rest: Float[Array, "k 3"]) -> Float[Array, " m"]:
        """The gap (m,) [m] under each cell, mean over its points, when the flat disc first touches the body
        with nodes at `rest` (k, 3) m; far off where a cell meets nothing.
        """
        way = jnp.einsum("ps,psi,i->p", on.shape, rest[on.nodes], self.surface.direction)
        first = jnp.min(jnp.where(on.met, way, jnp.inf))
        each = self._over_cells(self.shares(on) * jnp.where(on.met, way - first, 0.0))
        return jnp.where(self._over_cells(1.0 * on.met) > 0, each, _NOWHERE)

    def _over_cells(self, each: Float[Array, " p"]) -> Float[Array, " m"]:
        return jnp.zeros(self.cells.count).at[self.cells.cell].add(each)

    def frame(self, body: AbstractBody) -> tuple[Float[Array, " 9"], Float[Array, "n 9"]]:
        """Mean position x (3,) [m] of the patch and its mean tangents ∂x/∂s_1, ∂x/∂s_2 (3,) [-] at rest, and
        the rows of these nine numbers.

        Means over points that meet the body; the tangents' cross product is the current normal, inwards.
        """
        on = self.landed(body)
        share = jnp.where(on.met, self.cells.share, 0.0)
        share = share / jnp.sum(share)
        each = share[:, None, None] * jnp.concatenate([on.shape[:, :, None], on.slopes], axis=2)
        rest = jnp.einsum("psk,psi->ki", each, body.rest[on.nodes]).ravel()
        spread = jnp.einsum("psk,ij->psikj", each, jnp.eye(3)).reshape(*each.shape[:2], 3, 9)
        return rest, body.spread(on.nodes, spread)

    def overlap(self, body: AbstractBody) -> Float[Array, ""]:
        """Fraction of the disc's quadrature points on the surface [-]: 1 unless it overhangs an edge."""
        return jnp.mean(self.landed(body).met, dtype=float)
