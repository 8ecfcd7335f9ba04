"""Tetrahedral meshes of first and second order.

A tetrahedron (a, b, c, d) has the signed volume V = (b − a) · ((c − a) × (d − a)) / 6; it is positive when
its nodes are in the order of VTK and meshio, and the library accepts nothing else. A quadratic tetrahedron
lists its four corners, then the nodes in the middle of the edges (0,1), (1,2), (0,2), (0,3), (1,3), (2,3)
(VTK's QUADRATIC_TETRA, meshio's tetra10). Corner nodes come first among the nodes, so that a continuous
linear field (the pressure of a Taylor-Hood element) lives on nodes[:n_corners].

Source: VTK file formats, https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""Local corner pairs of the six edges, in the order of the mid-edge nodes."""

FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
"""Local corners of the four faces, counter-clockwise seen from outside a positive tetrahedron."""

FACES6 = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]])
"""The same faces with the nodes in the middle of their edges (0,1), (1,2), (2,0)."""


@dataclass(frozen=True, eq=False)
class TetMesh:
    """Nodes (n, 3) in metres, tetrahedra (m, 4) or (m, 10), and the material region (m,) of each.

    groups: pairs of corners (e, 2), by the names that a file gives them (softfuse/mesh/groups.py).
    """

    nodes: Float[np.ndarray, "n 3"]
    tets: Int[np.ndarray, "m k"]
    region: Int[np.ndarray, " m"]
    groups: Mapping[str, Int[np.ndarray, "_ 2"]] = field(default_factory=dict)

    @property
    def order(self) -> int:
        """Polynomial order of the shape functions: 1 or 2."""
        return 1 if self.tets.shape[1] == 4 else 2

    @property
    def n_corners(self) -> int:
        """Number of corner nodes; they are nodes[:n_corners]."""
        return int(self.tets[:, :4].max()) + 1

    @property
    def corners(self) -> Int[np.ndarray, "m 4"]:
        """Corner nodes (m, 4) of every tetrahedron."""
        return self.tets[:, :4]


def tet_mesh(nodes: ArrayLike, tets: ArrayLike, *, region: ArrayLike | None = None) -> TetMesh:
    """A mesh from any arrays of numbers: nodes (n, 3) m, tets (m, 4) or (m, 10), region (m,) or all 0."""
    tets = np.ascontiguousarray(tets, dtype=np.int32)
    region = np.ascontiguousarray(np.zeros(len(tets)) if region is None else region, dtype=np.int32)
    return TetMesh(np.ascontiguousarray(nodes, dtype=np.float64), tets, region)


def volumes(mesh: TetMesh) -> Float[np.ndarray, " m"]:
    """Signed volumes (m,) in m³ of the tetrahedra spanned by the corners."""
    a, b, c, d = (mesh.nodes[mesh.tets[:, k]] for k in range(4))
    return np.einsum("mi,mi->m", b - a, np.cross(c - a, d - a)) / 6.0


def nodal_jacobians(mesh: TetMesh) -> Float[np.ndarray, "m 10"]:
    """Determinants (m, 10) in m³ of ∂x/∂ξ at the nodes of quadratic tetrahedra; 6 V with straight edges."""
    result = np.empty((len(mesh.tets), 10))
    for k, place in enumerate(np.concatenate([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])):
        slopes = np.empty((10, 4))
        slopes[:4] = np.diag(4.0 * place - 1.0)
        slopes[4:] = 4.0 * (
            place[EDGES[:, 1:]] * np.eye(4)[EDGES[:, 0]] + place[EDGES[:, :1]] * np.eye(4)[EDGES[:, 1]]
        )
        jacobian = np.einsum("mai,ad->mid", mesh.nodes[mesh.tets], slopes[:, 1:] - slopes[:, :1])
        result[:, k] = np.linalg.det(jacobian)
    return result


def edge_lengths(mesh: TetMesh) -> Float[np.ndarray, "m 6"]:
    """Lengths (m, 6) in m of the straight edges of every tetrahedron, in the order of EDGES."""
    ends = mesh.nodes[mesh.tets[:, EDGES]]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1)


def quadratic(mesh: TetMesh) -> TetMesh:
    """The mesh with a node in the middle of every edge; corners keep their numbers, edges stay straight."""
    if mesh.order == 2:
        return mesh
    pairs = np.sort(mesh.tets[:, EDGES], axis=-1).reshape(-1, 2).astype(np.int64)
    count = len(mesh.nodes)
    unique, place = np.unique(pairs[:, 0] * count + pairs[:, 1], return_inverse=True)
    middle = 0.5 * (mesh.nodes[unique // count] + mesh.nodes[unique % count])
    tets = np.hstack([mesh.tets, count + place.reshape(-1, 6)])
    return replace(tet_mesh(np.vstack([mesh.nodes, middle]), tets, region=mesh.region), groups=mesh.groups)


def linear(mesh: TetMesh) -> TetMesh:
    """The mesh of the corners alone; curved edges become straight."""
    if mesh.order == 1:
        return mesh
    corners = tet_mesh(mesh.nodes[: mesh.n_corners], mesh.corners, region=mesh.region)
    return replace(corners, groups=mesh.groups)
