"""Flat triangles in the place of a cavity's curved surface, as many as a tolerance in length needs.

The surface is star-shaped, x(u) = c + R (h ∘ r(u) u): triangles between directions u that cover the sphere
once close it and cannot pass through each other. Beginning with those of a `cube_sphere`, each edge over
which the surface is too high is halved, u → (u_a + u_b) / |u_a + u_b|, and triangles are cut in two, three or
four by which of their edges are: neighbours see the same edge and agree, so the surface stays closed.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.errors import SoftfuseError
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.cube_sphere import cube_sphere

_CELLS = 12
"""Along an edge of the cube that the triangles begin with."""

_AT = (0.25, 0.5, 0.75)
"""Parts of an edge over which the height of the surface is looked at: a fillet may begin anywhere."""

_MOST = 500_000
"""Triangles of a cavity."""

_TOGETHER = 4096
"""Points of a surface that are computed at once, so that there is one program for all numbers of them."""


def facets(
    shape: CavityShape, values: Float[Array, " v"], height: float
) -> tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, "f 3"]]:
    """Points (m, 3) [m] of a cavity's surface and the triangles (f, 3) between them, normals outwards,
    none of whose edges is farther than `height` m from the surface above it; values (v,) of the cavity.

    Raises SoftfuseError where that takes half a million triangles.
    """
    directions, faces = cube_sphere(_CELLS)
    points = _points(shape, values, directions)
    while len(faces) <= _MOST:
        edges, sides = _edges(faces)
        high = _heights(shape, values, directions, points, edges) > height
        if not high.any():
            return points, faces
        middle = _between(directions, edges[high], 0.5)
        number = np.full(len(edges), -1)
        number[high] = len(directions) + np.arange(len(middle))
        directions = np.concatenate([directions, middle])
        points = np.concatenate([points, _points(shape, values, middle)])
        faces = _cut(faces, number[sides])
    raise SoftfuseError(
        f"a cavity within {1e6 * height:g} µm takes more than {_MOST} triangles: allow "
        "more, or give it wider fillets"
    )


def _edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "f 3"]]:
    """Edges (e, 2) and which of them (f, 3) follow the corners of each triangle."""
    each = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    edges, place = np.unique(each, axis=0, return_inverse=True)
    return edges, place.reshape(-1, 3)


def _heights(
    shape: CavityShape,
    values: Float[Array, " v"],
    directions: Float[np.ndarray, "m 3"],
    points: Float[np.ndarray, "m 3"],
    edges: Int[np.ndarray, "e 2"],
) -> Float[np.ndarray, " e"]:
    """How far (e,) [m] the surface is at most from the lines through its edges, over parts of these."""
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    heights = np.zeros(len(edges))
    for part in _AT:
        offset = _points(shape, values, _between(directions, edges, part)) - start
        across = offset - np.einsum("ei,ei->e", offset, along)[:, None] * along
        heights = np.maximum(heights, np.linalg.norm(across, axis=1))
    return heights


def _between(
    directions: Float[np.ndarray, "m 3"], edges: Int[np.ndarray, "e 2"], part: float
) -> Float[np.ndarray, "e 3"]:
    """Unit directions (e, 3) over a part of each edge, equal in both senses where it is a half."""
    chord = (1.0 - part) * directions[edges[:, 0]] + part * directions[edges[:, 1]]
    return chord / np.linalg.norm(chord, axis=1, keepdims=True)


def _cut(faces: Int[np.ndarray, "f 3"], middle: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "g 3"]:
    """Triangles with a node in the middle of the edges (f, 3) after each corner, −1 where there is none."""
    count = (middle >= 0).sum(axis=1)
    # What is alone among the three, the edge that is cut or the one that is not, goes first.
    first = np.where(count == 1, np.argmax(middle >= 0, axis=1), np.argmin(middle, axis=1))
    order = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, order, axis=1).T
    ab, bc, ca = np.take_along_axis(middle, order, axis=1).T
    kinds = (
        [(a, b, c)],
        [(a, ab, c), (ab, b, c)],
        [(a, b, bc), (a, bc, ca), (ca, bc, c)],
        [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
    )
    parts = [np.stack(corners, axis=1)[count == k] for k, kind in enumerate(kinds) for corners in kind]
    return np.concatenate(parts)


def _points(
    shape: CavityShape, values: Float[Array, " v"], directions: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m 3"]:
    points = np.empty_like(directions)
    for at in range(0, len(directions), _TOGETHER):
        part = directions[at : at + _TOGETHER]
        filled = np.concatenate([part, np.tile(directions[:1], (_TOGETHER - len(part), 1))])
        points[at : at + _TOGETHER] = np.asarray(_compiled(shape, values, filled))[: len(part)]
    return points


@eqx.filter_jit
def _compiled(
    shape: CavityShape, values: Float[Array, " v"], directions: Float[Array | np.ndarray, "m 3"]
) -> Float[Array, "m 3"]:
    return shape.points(values, directions)
