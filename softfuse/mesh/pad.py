"""The soft pad: a block on a rigid plate, with closed box-shaped cavities, meshed finer towards its top.

z runs from the fixed bottom (0) to the loaded top (size[2]); x and y are centred. A tensor grid through all
planes of the block, the cavities and the middle is cut into tetrahedra (see `kuhn`), the cavities left out,
and cut further (see `bisection`) until no edge is longer than

    h = surface_size + growth · max(0, d − fine_depth)

with d the depth of the tetrahedron's highest corner below the top. The mesh has the mirror symmetries of the
pad.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.mesh.bisection import refined
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import EDGES, TetMesh, tet_mesh

_SAME = 1e-9
"""Relative difference below which two lengths are one, so that rounding does not break the symmetry."""

_THIN = 0.05
"""Smallest distance of two grid planes over base_size that still gives usable tetrahedra."""


@dataclass(frozen=True)
class PadGeometry:
    """Block size (3,) m; size (3,) m, centres (k, 2) m and floor height in m of its cavities."""

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


def pad_mesh(
    geometry: PadGeometry,
    surface_size: float,
    base_size: float,
    *,
    growth: float = 1.0,
    fine_depth: float = 0.0,
) -> TetMesh:
    """Linear tetrahedra of the pad, edges at the top at most surface_size m, grid boxes at most base_size m.

    The longest edge stays the same down to fine_depth m, then gains growth metres per metre. Raises MeshError
    when a length is not positive, a cavity reaches the surface, two cavities touch or their planes nearly
    coincide.
    """
    if surface_size <= 0.0 or growth < 0.0 or fine_depth < 0.0:
        raise MeshError("surface_size must be positive, growth and fine_depth not negative")

    def longest(corners: np.ndarray) -> np.ndarray:
        depth = geometry.size[2] - corners[:, :, 2].max(axis=1)
        return surface_size + growth * np.maximum(depth - fine_depth, 0.0)

    return sized_pad_mesh(geometry, base_size, longest)


def sized_pad_mesh(
    geometry: PadGeometry, base_size: float, longest: Callable[[np.ndarray], np.ndarray]
) -> TetMesh:
    """Linear tetrahedra of the pad whose edges are at most `longest(corners (m, 4, 3) m)` (m,) in m.

    For refinement around a known contact; otherwise, and for the errors raised, see `pad_mesh`.
    """
    _check(geometry, base_size)
    planes, odd = zip(*(_planes(geometry, axis, base_size) for axis in range(3)), strict=True)
    middles = [0.5 * (p[1:] + p[:-1]) for p in planes]
    grid = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
    half = 0.5 * np.array(geometry.cavity_size)
    keep = np.ones(grid.shape[:3], bool)
    for centre in geometry.centres():
        keep &= ~(np.abs(grid - centre) < half).all(axis=-1)

    def too_large(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
        ends = nodes[tets[:, EDGES]]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1).max(axis=1)
        return length > longest(nodes[tets]) * (1.0 + _SAME)

    mesh = refined(kuhn_grid(planes, keep, odd), too_large)
    return oriented(tet_mesh(mesh.nodes, mesh.tets, region=mesh.region))


def _planes(geometry: PadGeometry, axis: int, base_size: float) -> tuple[Float[np.ndarray, " n"], int]:
    """Grid planes in m along an axis and the parity of the one where the diagonals start."""
    size, half = geometry.size[axis], 0.5 * geometry.cavity_size[axis]
    ends = [0.0, size] if axis == 2 else [-0.5 * size, 0.0, 0.5 * size]
    sides = geometry.centres()[:, axis]
    fixed = np.sort(np.concatenate([ends, sides - half, sides + half]))
    fixed = fixed[np.append(True, np.diff(fixed) > _SAME * size)]
    gaps = np.diff(fixed)
    if gaps.min() < _THIN * base_size:
        at = int(np.argmin(gaps))
        raise MeshError(
            f"planes of the pad's cavities lie {1e3 * gaps[at]:.3g} mm apart at {'xyz'[axis]} = "
            f"{1e3 * fixed[at]:.4g} mm: align the cavities, mesh, then shift them with `moved_cavities`"
        )
    pieces = [
        np.linspace(a, b, int(np.ceil((b - a) / base_size * (1.0 - _SAME))), endpoint=False)
        for a, b in zip(fixed[:-1], fixed[1:], strict=True)
    ]
    planes = np.append(np.concatenate(pieces), fixed[-1])
    start = size if axis == 2 else 0.0
    return planes, int(np.argmin(np.abs(planes - start))) % 2


def _check(geometry: PadGeometry, base_size: float) -> None:
    if min(*geometry.size, *geometry.cavity_size, base_size) <= 0.0:
        raise MeshError("size, cavity_size and base_size must be positive")
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
