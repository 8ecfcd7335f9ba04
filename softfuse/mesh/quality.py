"""How well shaped and how large the tetrahedra of a mesh are.

Mean ratio of a tetrahedron: η = 12 (3 V)^(2/3) / Σ l², the sum over its six edges; 1 when regular, 0 when
flat (A. Liu, B. Joe, BIT 34, 1994, DOI 10.1007/BF01955874). The dihedral angle at an edge is the inner angle
between the two faces that meet there; 70.5° at every edge of a regular tetrahedron.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.mesh.surface import cavities, enclosed_volume
from softfuse.mesh.tetmesh import EDGES, TetMesh, edge_lengths, nodal_jacobians, volumes

_OPPOSITE = np.array([[2, 3], [0, 3], [1, 3], [1, 2], [0, 2], [0, 1]])
"""The corners that are not on an edge, in the order of EDGES."""


@dataclass(frozen=True)
class Spread:
    """Smallest, mean and largest of a quantity, in its unit."""

    least: float
    mean: float
    most: float


@dataclass(frozen=True)
class MeshQuality:
    """Counts, sizes in m and m³, mean ratios (0 to 1) and dihedral angles in degrees of a mesh.

    cavity_volumes (k,) m³ follow the order of `cavities` without centres; regions lists the region numbers in
    use.
    """

    n_nodes: int
    n_corners: int
    n_tets: int
    order: int
    regions: tuple[int, ...]
    volume: float
    cavity_volumes: tuple[float, ...]
    tet_volume: Spread
    edge_length: Spread
    mean_ratio: Spread
    dihedral_angle: Spread


def mesh_quality(mesh: TetMesh) -> MeshQuality:
    """Measure a mesh in the accepted form; curved edges count as straight.

    Raises MeshError when the mesh falls into several parts.
    """
    size = volumes(mesh)
    return MeshQuality(
        n_nodes=len(mesh.nodes),
        n_corners=mesh.n_corners,
        n_tets=len(mesh.tets),
        order=mesh.order,
        regions=tuple(np.unique(mesh.region).tolist()),
        volume=float(size.sum()),
        cavity_volumes=tuple(enclosed_volume(mesh.nodes, part.faces) for part in cavities(mesh)),
        tet_volume=_spread(size),
        edge_length=_spread(edge_lengths(mesh)),
        mean_ratio=_spread(mean_ratios(mesh)),
        dihedral_angle=_spread(dihedral_angles(mesh)),
    )


def mean_ratios(mesh: TetMesh) -> Float[np.ndarray, " m"]:
    """Mean ratio (m,) of every tetrahedron, without unit; negative where its volume is."""
    size = volumes(mesh)
    return 12.0 * np.sign(size) * np.cbrt(3.0 * size) ** 2 / (edge_lengths(mesh) ** 2).sum(axis=1)


def curved_mean_ratios(mesh: TetMesh) -> Float[np.ndarray, " m"]:
    """Mean ratio (m,) of every quadratic tetrahedron with its smallest Jacobian in the place of its volume.

    det ∂x/∂ξ / 6 at its nodes, where it is the volume of a straight tetrahedron everywhere: η = sign(V)
    12 (3 |V|)^(2/3) / Σ l² with the straight edges l; 0 or less where the tetrahedron is turned inside out.
    """
    least = nodal_jacobians(mesh).min(axis=1) / 6.0
    return 12.0 * np.sign(least) * np.cbrt(3.0 * np.abs(least)) ** 2 / (edge_lengths(mesh) ** 2).sum(axis=1)


def dihedral_angles(mesh: TetMesh) -> Float[np.ndarray, "m 6"]:
    """Inner angles (m, 6) in degrees between the faces at every edge, in the order of EDGES."""
    ends, rest = mesh.nodes[mesh.tets[:, EDGES]], mesh.nodes[mesh.tets[:, _OPPOSITE]]
    axis = ends[:, :, 1] - ends[:, :, 0]
    first = np.cross(axis, rest[:, :, 0] - ends[:, :, 0])
    second = np.cross(axis, rest[:, :, 1] - ends[:, :, 0])
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.degrees(np.arctan2(sine, (first * second).sum(axis=-1)))


def _spread(values: np.ndarray) -> Spread:
    return Spread(float(values.min()), float(values.mean()), float(values.max()))
