"""Directions spread over the sphere as a grid on the faces of a cube, its edges and corners included.

The grid has equal angles from a face's middle, u ∝ (1, tan α, tan β) with |α|, |β| ≤ π/4, which spreads it
more evenly than equal lengths (C. Ronchi, R. Iacono, P. S. Paolucci, J. Comput. Phys. 124, 1996, DOI
10.1006/jcph.1996.0047).
"""

from functools import cache

import numpy as np
from jaxtyping import Float, Int


@cache
def cube_sphere(cells: int) -> tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, "f 3"]]:
    """Unit directions (6 cells² + 2, 3) and the triangles (12 cells², 3) between them, normals outwards.

    cells: how many there are along an edge of the cube, 1 or more.
    """
    k = np.arange(cells + 1)
    first, second = (a.ravel() for a in np.meshgrid(k, k, indexing="ij"))
    lattice, corners = [], []
    for axis in range(3):
        for end in (0, cells):
            place = np.empty((len(first), 3), np.int64)
            place[:, axis] = end
            # Going round the axes keeps the sense: first × second points along +axis.
            place[:, (axis + 1) % 3], place[:, (axis + 2) % 3] = first, second
            lattice.append(place)
            corners.append(_triangles(cells, outwards=end > 0))
    unique, number = np.unique(np.concatenate(lattice), axis=0, return_inverse=True)
    shift = (cells + 1) ** 2 * np.arange(6)
    faces = np.ravel(number)[np.concatenate([part + s for part, s in zip(corners, shift, strict=True)])]
    grid = np.tan(0.25 * np.pi * (2.0 * unique / cells - 1.0))
    return grid / np.linalg.norm(grid, axis=1, keepdims=True), faces


def _triangles(cells: int, *, outwards: bool) -> Int[np.ndarray, "f 3"]:
    i, j = (a.ravel() for a in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    a = i * (cells + 1) + j
    b, c, d = a + cells + 1, a + cells + 2, a + 1
    halves = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return halves if outwards else halves[:, ::-1]
