"""Which faces of a surface points may lie over, seen along the direction in which they press.

A search names candidates, and the surface tests each of them: a search can miss a face, but not invent one.
`EveryFace` misses none and is the definition; `FaceBuckets` names a few and finds the same.
"""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

# In mean sizes of a face. On a regular mesh squares of twice the width have twice as many faces near.
_WIDTH, _MARGIN = 0.125, 0.25


class AbstractFaceSearch(eqx.Module):
    """Names those of a surface's f faces that points of the plane across its direction may lie over."""

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


def _by_square(near: list[Int[np.ndarray, " n"]], squares: int) -> Int[np.ndarray, "q c"]:
    """The faces of each square in ascending order, from the squares near each face.

    To be as many everywhere the last one is repeated; squares without any name one that is elsewhere.
    """
    square = np.concatenate(near)
    order = np.argsort(square, kind="stable")
    face = np.repeat(np.arange(len(near), dtype=np.int32), [len(each) for each in near])[order]
    count = np.bincount(square, minlength=squares)
    own = np.minimum(np.arange(count.max()), np.maximum(count - 1, 0)[:, None])
    return face[np.minimum((np.cumsum(count) - count)[:, None] + own, len(face) - 1)]
