"""Shape functions of linear and quadratic simplices in barycentric coordinates.

A quadratic simplex has its corners first, then the middles of its edges, in the order of
`softfuse.mesh.tetmesh.EDGES`: N_i = L_i (2 L_i − 1) at corners and N_ij = 4 L_i L_j on edges. Source:
Zienkiewicz and Taylor, The Finite Element Method, vol. 1, ch. 8.
"""

from typing import TypeVar

import numpy as np
from jaxtyping import Array

from softfuse.mesh.tetmesh import EDGES

Coordinates = TypeVar("Coordinates", Array, np.ndarray)

TRIANGLE_EDGES = np.array([(0, 1), (1, 2), (2, 0)])


def linear(barycentric: Coordinates) -> Coordinates:
    """Values of the linear shape functions: the barycentric coordinates (..., d) themselves."""
    return barycentric


def quadratic(barycentric: Coordinates) -> Coordinates:
    """Values (..., a) of the quadratic shape functions at barycentric coordinates (..., d), d = 3 or 4."""
    edges = TRIANGLE_EDGES if barycentric.shape[-1] == 3 else EDGES
    corners = barycentric * (2 * barycentric - 1)
    middles = 4 * barycentric[..., edges[:, 0]] * barycentric[..., edges[:, 1]]
    # Of numpy's arrays in numpy: elements are made on import, which must not start JAX.
    return barycentric.__array_namespace__().concat([corners, middles], axis=-1)


def linear_slopes(barycentric: np.ndarray) -> np.ndarray:
    """∂N_a/∂L_i (q, d, d) of the linear shape functions at barycentric points (q, d)."""
    d = barycentric.shape[-1]
    return np.broadcast_to(np.eye(d), (len(barycentric), d, d)).copy()


def quadratic_slopes(barycentric: np.ndarray) -> np.ndarray:
    """∂N_a/∂L_i (q, a, d) of the quadratic shape functions at barycentric points (q, d), each L_i taken as
    independent.
    """
    q, d = barycentric.shape
    edges = TRIANGLE_EDGES if d == 3 else EDGES
    slopes = np.zeros((q, d + len(edges), d))
    for i in range(d):
        slopes[:, i, i] = 4 * barycentric[:, i] - 1
    for m, (i, j) in enumerate(edges):
        slopes[:, d + m, i] = 4 * barycentric[:, j]
        slopes[:, d + m, j] = 4 * barycentric[:, i]
    return slopes
