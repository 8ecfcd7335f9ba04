"""Nearest points on triangles, for points anywhere around a surface.

On each triangle the nearest point is the foot of the perpendicular where that lies inside, else the nearest
point of an edge. A tree of the triangles' middles names those that can be nearest: a triangle reaches no
further from its middle than its furthest corner.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

_EDGES = ((0, 1), (1, 2), (2, 0))


class Nearest(NamedTuple):
    """Of each of p points: the triangle (p,), barycentric coordinates there (p, 3), and distance (p,) [m]."""

    triangle: Int[np.ndarray, " p"]
    barycentric: Float[np.ndarray, "p 3"]
    distance: Float[np.ndarray, " p"]


def nearest_on_triangles(points: Float[np.ndarray, "p 3"], corners: Float[np.ndarray, "f 3 3"]) -> Nearest:
    """The nearest places on triangles with corners (f, 3, 3) m to points (p, 3) m."""
    middles = corners.mean(axis=1)
    size = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    tree = KDTree(middles)
    # The nearest middle is on its triangle, so nothing further than it has to be looked at.
    bound, _ = tree.query(points)
    near = tree.query_ball_point(points, bound + size.max())
    triangle, place = np.empty(len(points), int), np.empty((len(points), 3))
    distance = np.empty(len(points))
    for k, candidates in enumerate(near):
        one = np.asarray(candidates)
        one = one[np.linalg.norm(middles[one] - points[k], axis=1) <= bound[k] + size[one] + 1e-12]
        inside, apart = _on_each(points[k], corners[one])
        best = int(np.argmin(apart))
        triangle[k], place[k], distance[k] = one[best], inside[best], apart[best]
    return Nearest(triangle, place, distance)


def _on_each(
    point: Float[np.ndarray, "3"], corners: Float[np.ndarray, "f 3 3"]
) -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, " f"]]:
    """Barycentric coordinates (f, 3) of the place on each triangle nearest to a point, and distances (f,)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    away = point - corners[:, 0]
    aa, ab, bb = (np.einsum("fi,fi->f", p, q) for p, q in ((a, a), (a, b), (b, b)))
    pa, pb = (np.einsum("fi,fi->f", away, q) for q in (a, b))
    twice = np.maximum(aa * bb - ab**2, np.finfo(float).tiny)
    second, third = (bb * pa - ab * pb) / twice, (aa * pb - ab * pa) / twice
    best = np.stack([1 - second - third, second, third], axis=1)
    apart = _apart(point, corners, best)
    apart[best.min(axis=1) < 0] = np.inf
    for i, j in _EDGES:
        edge = corners[:, j] - corners[:, i]
        along = np.einsum("fi,fi->f", point - corners[:, i], edge) / np.einsum("fi,fi->f", edge, edge)
        place = np.zeros_like(best)
        place[:, j] = np.clip(along, 0.0, 1.0)
        place[:, i] = 1 - place[:, j]
        there = _apart(point, corners, place)
        closer = there < apart
        best[closer], apart[closer] = place[closer], there[closer]
    return best, apart


def _apart(point: np.ndarray, corners: np.ndarray, place: np.ndarray) -> Float[np.ndarray, " f"]:
    return np.linalg.norm(np.einsum("fk,fki->fi", place, corners) - point, axis=1)
