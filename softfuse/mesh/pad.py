"""The soft pad: a block on a rigid plate, with closed box-shaped cavities, meshed finer towards its top.

z runs from the fixed bottom (0) to the loaded top (size[2]); x and y are centred. A tensor grid through all
planes of the block, the cavities and the middle is cut into tetrahedra (see `kuhn`), the cavities left out,
and cut further (see `bisection`) until no edge is longer than

    h(z) = surface_size + growth · (size[2] − z)

with z the highest corner of the tetrahedron. A pad with mirror symmetry gets a mesh with the same symmetry.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.mesh.bisection import refined
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import EDGES, TetMesh, tet_mesh


@dataclass(frozen=True)
class PadGeometry:
    """Block size (3,) m, size (3,) m and centres (k, 2) m of its cavities, height of their floors in m."""

    size: tuple[float, float, float]
    cavity_size: tuple[float, float, float]
    cavity_centres: tuple[tuple[float, float], ...]
    cavity_z_bottom: float

    def centres(self) -> Float[np.ndarray, "k 3"]:
        """Centres (k, 3) in m of the cavities, in the order of the config."""
        z = self.cavity_z_bottom + 0.5 * self.cavity_size[2]
        return np.array([(x, y, z) for x, y in self.cavity_centres]).reshape(-1, 3)

    def volume(self) -> float:
        """Volume of the material in m³."""
        return float(np.prod(self.size) - len(self.cavity_centres) * np.prod(self.cavity_size))


def pad_mesh(geometry: PadGeometry, surface_size: float, base_size: float, *, growth: float = 1.0) -> TetMesh:
    """Linear tetrahedra of the pad, longest edge at the top surface_size m, grid cells at most base_size m.

    growth: metres of edge length gained per metre below the top. Raises MeshError when a cavity leaves the
    block, two cavities touch, or a size is not positive.
    """
    _check(geometry, surface_size, base_size, growth)
    planes, odd = zip(*(_planes(geometry, axis, base_size) for axis in range(3)), strict=True)
    middles = [0.5 * (p[1:] + p[:-1]) for p in planes]
    grid = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
    half = 0.5 * np.array(geometry.cavity_size)
    keep = np.ones(grid.shape[:3], bool)
    for centre in geometry.centres():
        keep &= ~(np.abs(grid - centre) < half).all(axis=-1)

    def too_large(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
        ends = nodes[tets[:, EDGES]]
        longest = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1).max(axis=1)
        depth = geometry.size[2] - nodes[tets, 2].max(axis=1)
        return longest > (surface_size + growth * depth) * (1.0 + 1e-9)

    mesh = refined(kuhn_grid(planes, keep, odd), too_large)
    return oriented(tet_mesh(mesh.nodes, mesh.tets, region=mesh.region))


def _planes(geometry: PadGeometry, axis: int, base_size: float) -> tuple[Float[np.ndarray, " n"], int]:
    """Grid planes in m along an axis and the parity of the one where the diagonals start."""
    size, half = geometry.size[axis], 0.5 * geometry.cavity_size[axis]
    ends = [0.0, size] if axis == 2 else [-0.5 * size, 0.0, 0.5 * size]
    sides = np.unique(geometry.centres()[:, axis])
    fixed = np.array(ends + (sides - half).tolist() + (sides + half).tolist())
    fixed = np.unique(np.round(fixed, 12))
    pieces = [
        np.linspace(a, b, int(np.ceil((b - a) / base_size * (1.0 - 1e-9))), endpoint=False)
        for a, b in zip(fixed[:-1], fixed[1:], strict=True)
    ]
    planes = np.append(np.concatenate(pieces), fixed[-1])
    start = size if axis == 2 else 0.0
    return planes, int(np.argmin(np.abs(planes - start))) % 2


def _check(geometry: PadGeometry, surface_size: float, base_size: float, growth: float) -> None:
    if min(*geometry.size, *geometry.cavity_size, surface_size, base_size) <= 0.0 or growth < 0.0:
        raise MeshError("every length of the pad and of its mesh must be positive, growth not negative")
    size, cavity = np.array(geometry.size), np.array(geometry.cavity_size)
    low, high = np.array([-0.5, -0.5, 0.0]) * size, np.array([0.5, 0.5, 1.0]) * size
    centres = geometry.centres()
    for k, centre in enumerate(centres):
        if (centre - 0.5 * cavity <= low).any() or (centre + 0.5 * cavity >= high).any():
            raise MeshError(
                f"cavity {k} at {(1e3 * centre).round(3).tolist()} mm reaches the surface of the pad: "
                "make it smaller or move it"
            )
        for j in range(k):
            if (np.abs(centre - centres[j]) <= cavity).all():
                raise MeshError(f"cavities {j} and {k} touch: leave a wall between them")
