"""Blocks with box-shaped holes, cut into tetrahedra: what the parametric bodies have in common.

A tensor grid through all faces of the block and its holes is cut into tetrahedra (see `kuhn`), the holes left
out, and cut further (see `bisection`) until no edge is longer than the caller's size function allows. The
mesh is its own mirror image in every plane of the grid in which the body is, so that a body asks for planes
in its symmetries.
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

NO_BOXES: Float[np.ndarray, "0 2 3"] = np.empty((0, 2, 3))

SIDES = ("low x", "low y", "low z", "high x", "high y", "high z")
"""Names of a block's faces."""

NORMALS: Float[np.ndarray, "6 3"] = np.vstack([-np.eye(3), np.eye(3)])
"""Outward unit normals (6, 3) of its faces, in the order of SIDES."""


@dataclass(frozen=True, eq=False)
class Block:
    """Lowest and highest corner (3,) m of a block, its holes, and planes that the grid ought to have.

    cavities (k, 2, 3), notches (n, 2, 3): lowest and highest corners in m of closed holes, and of holes that
    open at the surface. planes: positions in m along x, y, z; the grid's diagonals start at the first of each
    axis, and a face of the body that is very near takes the place of a plane.
    """

    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    cavities: Float[np.ndarray, "k 2 3"]
    notches: Float[np.ndarray, "n 2 3"]
    planes: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]

    @property
    def holes(self) -> Float[np.ndarray, "h 2 3"]:
        """Lowest and highest corners (k + n, 2, 3) in m of cavities and notches."""
        return np.concatenate([self.cavities, self.notches])

    @property
    def offsets(self) -> Float[np.ndarray, "6"]:
        """How far (6,) m the block reaches along NORMALS."""
        return np.concatenate([-self.low, self.high])

    def check(self) -> None:
        """Raise MeshError where the block or a notch has no volume."""
        boxes = np.concatenate([np.stack([self.low, self.high])[None], self.notches])
        flat = (boxes[:, 1] <= boxes[:, 0]).any(axis=1)
        if flat.any():
            k = int(np.argmax(flat))
            what = "the block" if k == 0 else f"notch {k - 1}"
            raise MeshError(
                f"{what} has no volume: its highest corner must lie above its lowest along x, y, z"
            )

    def volume(self) -> float:
        """Volume of the material in m³; the holes must not overlap nor leave the block."""
        return float(np.prod(self.high - self.low) - np.ptp(self.holes, axis=1).prod(axis=1).sum())


def whole_block(size: tuple[float, float, float], cavities: Float[np.ndarray, "k 2 3"] = NO_BOXES) -> Block:
    """A block of a size (3,) m with boxes (k, 2, 3) m for cavities and no notches: z from 0 at its bottom, x
    and y centred, planes in its middle and at its top.
    """
    x, y, z = size
    return Block(
        low=np.array([-0.5 * x, -0.5 * y, 0.0]),
        high=np.array([0.5 * x, 0.5 * y, z]),
        cavities=cavities,
        notches=NO_BOXES,
        planes=((0.0,), (0.0,), (z,)),
    )


@dataclass(frozen=True, eq=False)
class Fineness:
    """Edges of a mesh: grid boxes of at most `base_size` m, then cut until no edge is longer than
    `longest(corners (m, 4, 3) m)` (m,) in m allows, such as `finer_to_the_top`.
    """

    base_size: float
    longest: Callable[[np.ndarray], np.ndarray]


def finer_to_the_top(
    top: float, surface_size: float, *, growth: float = 1.0, fine_depth: float = 0.0
) -> Callable[[np.ndarray], np.ndarray]:
    """The longest edges (m,) in m that tetrahedra of corners (m, 4, 3) m may have, in a body whose top is at
    z = `top` m: surface_size + growth · max(0, d − fine_depth), d the depth of the highest corner.

    Raises MeshError when surface_size is not positive, or growth or fine_depth are negative.
    """
    if surface_size <= 0.0 or growth < 0.0 or fine_depth < 0.0:
        raise MeshError("surface_size must be positive, growth and fine_depth not negative")

    def longest(corners: np.ndarray) -> np.ndarray:
        depth = top - corners[:, :, 2].max(axis=1)
        return surface_size + growth * np.maximum(depth - fine_depth, 0.0)

    return longest


def finer_to_edges(
    boxes: Float[np.ndarray, "k 2 3"], farthest: float, wall_size: float, *, growth: float
) -> Callable[[np.ndarray], np.ndarray]:
    """The longest edges (m,) in m that tetrahedra of corners (m, 4, 3) m may have around boxes (k, 2, 3) m:
    wall_size + growth · min(d, farthest), d the distance of the nearest corner from the boxes' edges.

    Raises MeshError when wall_size is not positive, or growth is negative.
    """
    if wall_size <= 0.0 or growth < 0.0:
        raise MeshError("wall_size must be positive, growth not negative")

    def longest(corners: np.ndarray) -> np.ndarray:
        distance = edge_distance(boxes, corners).min(axis=1)
        return wall_size + growth * np.minimum(distance, farthest)

    return longest


def centred_boxes(
    centres: Float[np.ndarray, "k 3"], size: tuple[float, float, float]
) -> Float[np.ndarray, "k 2 3"]:
    """Lowest and highest corners (k, 2, 3) in m of boxes of one size (3,) m around centres (k, 3) m."""
    half = 0.5 * np.array(size)
    return np.stack([centres - half, centres + half], axis=1)


def edge_distance(
    boxes: Float[np.ndarray, "k 2 3"], points: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n"]:
    """Distances (*n) in m of points (*n, 3) m from the nearest edge of any of the boxes (k, 2, 3) m.

    With q the distances from the three pairs of faces, negative between them, the nearest edge along z is
    √(q_x² + q_y² + max(0, q_z)²) away. Infinite without boxes.
    """
    nearest = np.full(points.shape[:-1], np.inf)
    for low, high in boxes:
        q = np.abs(points - 0.5 * (low + high)) - 0.5 * (high - low)
        beyond = np.maximum(q, 0.0) ** 2
        for axis in range(3):
            across = (q**2).sum(axis=-1) - q[..., axis] ** 2
            nearest = np.minimum(nearest, np.sqrt(across + beyond[..., axis]))
    return nearest


def block_mesh(block: Block, base_size: float, longest: Callable[[np.ndarray], np.ndarray]) -> TetMesh:
    """Linear tetrahedra of a block, from grid boxes of at most base_size m, with edges of bounded length.

    `longest(corners (m, 4, 3) m)` returns the longest edge (m,) in m that each tetrahedron may have. Raises
    MeshError when base_size is not positive, a cavity reaches the surface or another hole, or two faces of
    the body lie too near to each other.
    """
    if base_size <= 0.0:
        raise MeshError("base_size must be positive")
    _check_cavities(block)
    x, y, z = (_planes(block, axis, base_size) for axis in range(3))
    middles = [0.5 * (p[1:] + p[:-1]) for p in (x, y, z)]
    grid = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
    keep = np.ones(grid.shape[:3], bool)
    for low, high in block.holes:
        keep &= ~((grid > low) & (grid < high)).all(axis=-1)
    first = (int(np.argmin(np.abs(p - w[0]))) for p, w in zip((x, y, z), block.planes, strict=True))
    odd_x, odd_y, odd_z = (k % 2 for k in first)

    def too_large(nodes: np.ndarray, tets: np.ndarray) -> np.ndarray:
        ends = nodes[tets[:, EDGES]]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1).max(axis=1)
        return length > longest(nodes[tets]) * (1.0 + _SAME)

    mesh = refined(kuhn_grid((x, y, z), keep, (odd_x, odd_y, odd_z)), too_large)
    return oriented(tet_mesh(mesh.nodes, mesh.tets, region=mesh.region))


def _planes(block: Block, axis: int, base_size: float) -> Float[np.ndarray, " n"]:
    """Grid planes (n,) in m along an axis."""
    fixed = np.sort(np.concatenate([[block.low[axis], block.high[axis]], block.holes[:, :, axis].ravel()]))
    fixed = fixed[np.append(True, np.diff(fixed) > _SAME * (fixed[-1] - fixed[0]))]
    gaps, thinnest = np.diff(fixed), _THIN * base_size
    if gaps.min() < thinnest:
        at = int(np.argmin(gaps))
        raise MeshError(
            f"faces of the body lie {1e3 * gaps[at]:.3g} mm apart at {'xyz'[axis]} = "
            f"{1e3 * fixed[at]:.4g} mm, too near for a base_size of {1e3 * base_size:.4g} mm: thicken the "
            "wall, if there is one, or lower base_size; else align the cavities, mesh, then shift them with "
            "`moved_cavities`"
        )
    free = [p for p in block.planes[axis] if np.abs(p - fixed).min() >= thinnest]
    fixed = np.unique(np.append(fixed, free))
    pieces = [_divided(a, b, base_size) for a, b in zip(fixed[:-1], fixed[1:], strict=True)]
    return np.append(np.concatenate(pieces), fixed[-1])


def _divided(start: float, end: float, base_size: float) -> Float[np.ndarray, " n"]:
    """Equal steps from start to end, which is left out; mirrored intervals have mirrored steps to the bit."""
    count = int(np.ceil((end - start) / base_size * (1.0 - _SAME)))
    if abs(end) < abs(start):
        return -np.linspace(-end, -start, count + 1)[:0:-1]
    return np.linspace(start, end, count, endpoint=False)


def _check_cavities(block: Block) -> None:
    gap = _SAME * (block.high - block.low)
    for k, (low, high) in enumerate(block.cavities):
        place = f"cavity {k} at {(500.0 * (low + high)).round(3).tolist()} mm"
        if (low <= block.low + gap).any() or (high >= block.high - gap).any():
            raise MeshError(f"{place} reaches the surface of the body: make it smaller or move it")
        meets = ((low <= block.holes[:, 1] + gap) & (high >= block.holes[:, 0] - gap)).all(axis=1)
        for j in np.flatnonzero(meets).tolist():
            if j < k:
                raise MeshError(f"cavities {j} and {k} touch: leave a wall between them")
            if j >= len(block.cavities):
                notch = (1e3 * block.holes[j]).round(3).tolist()
                raise MeshError(
                    f"{place} cuts the notch from {notch[0]} to {notch[1]} mm: make it smaller or move it"
                )
