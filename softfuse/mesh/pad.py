"""The soft pad: a block on a rigid plate, with closed box-shaped cavities, meshed finer towards its top.

z runs from the fixed bottom (0) to the loaded top (size[2]); x and y are centred. The mesh (see `block`) has
no edge longer than

    h = surface_size + growth · max(0, d − fine_depth)

with d the depth of the tetrahedron's highest corner below the top, and the mirror symmetries of the pad.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.mesh.block import Block, block_mesh, centred_boxes
from softfuse.mesh.drawing import AbstractBlockDrawing
from softfuse.mesh.tetmesh import TetMesh


@dataclass(frozen=True)
class PadGeometry(AbstractBlockDrawing):
    """Block size (3,) m; size (3,) m, centres (k, 2) m and floor height in m of its cavities."""

    size: tuple[float, float, float]
    cavity_size: tuple[float, float, float]
    cavity_centres: tuple[tuple[float, float], ...]
    cavity_z_bottom: float

    def centres(self) -> Float[np.ndarray, "k 3"]:
        """Centres (k, 3) in m of the cavities, in the order of the config."""
        z = self.cavity_z_bottom + 0.5 * self.cavity_size[2]
        return np.array([(x, y, z) for x, y in self.cavity_centres]).reshape(-1, 3)

    def block(self) -> Block:
        """The block with its cavities, planes of the grid in its middle."""
        x, y, z = self.size
        return Block(
            low=np.array([-0.5 * x, -0.5 * y, 0.0]),
            high=np.array([0.5 * x, 0.5 * y, z]),
            cavities=centred_boxes(self.centres(), self.cavity_size),
            notches=np.empty((0, 2, 3)),
            planes=((0.0,), (0.0,), (z,)),
        )

    def volume(self) -> float:
        """Volume of the material in m³."""
        return self.block().volume()

    def mesh(self, surface_size, base_size, *, growth=1.0, fine_depth=0.0):
        """Linear tetrahedra; see `pad_mesh`."""
        return pad_mesh(self, surface_size, base_size, growth=growth, fine_depth=fine_depth)


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
    longest = finer_to_the_top(geometry.size[2], surface_size, growth=growth, fine_depth=fine_depth)
    return sized_pad_mesh(geometry, base_size, longest)


def finer_to_the_top(
    top: float, surface_size: float, *, growth: float = 1.0, fine_depth: float = 0.0
) -> Callable[[np.ndarray], np.ndarray]:
    """The longest edges (m,) in m that tetrahedra of corners (m, 4, 3) m may have, in a body whose top is at
    z = `top` m; lengths and errors: see `pad_mesh`.
    """
    if surface_size <= 0.0 or growth < 0.0 or fine_depth < 0.0:
        raise MeshError("surface_size must be positive, growth and fine_depth not negative")

    def longest(corners: np.ndarray) -> np.ndarray:
        depth = top - corners[:, :, 2].max(axis=1)
        return surface_size + growth * np.maximum(depth - fine_depth, 0.0)

    return longest


def sized_pad_mesh(
    geometry: PadGeometry, base_size: float, longest: Callable[[np.ndarray], np.ndarray]
) -> TetMesh:
    """Linear tetrahedra of the pad whose edges are at most `longest(corners (m, 4, 3) m)` (m,) in m.

    For refinement around a known contact; otherwise, and for the errors raised, see `pad_mesh`.
    """
    if min(*geometry.size, *geometry.cavity_size) <= 0.0:
        raise MeshError("size and cavity_size must be positive")
    return block_mesh(geometry.block(), base_size, longest)
