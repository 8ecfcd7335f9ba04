"""The soft pad: a block on a rigid plate, with closed box-shaped cavities, meshed finer towards its top.

z runs from the fixed bottom (0) to the loaded top (size[2]); x and y are centred. The mesh (see `block`) has
no edge longer than

    h = surface_size + growth · max(0, d − fine_depth)

with d the depth of the tetrahedron's highest corner below the top, and the mirror symmetries of the pad.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.io.quantity import wrong_value
from softfuse.io.settings import Vector
from softfuse.mesh.block import Block, block_mesh, centred_boxes, finer_to_the_top, whole_block
from softfuse.mesh.body_source import BlockSource, Size
from softfuse.mesh.shell import Shell
from softfuse.mesh.tetmesh import TetMesh


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

    def block(self) -> Block:
        """The block with its cavities, planes of the grid in its middle."""
        return whole_block(self.size, centred_boxes(self.centres(), self.cavity_size))


class PadSource(BlockSource):
    """A block with equal box-shaped cavities of a cavity_size (3,) m, all at the same height."""

    type: Literal["pad"]
    cavity_size: Size

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The pad, meshed; see `pad_mesh` for the errors."""
        geometry = PadGeometry(
            size=self.size,
            cavity_size=self.cavity_size,
            cavity_centres=tuple(centre[:2] for centre in cavity_centres),
            cavity_z_bottom=cavity_centres[0][2] - 0.5 * self.cavity_size[2],
        )
        return pad_mesh(
            geometry, self.surface_size, self.base_size, growth=self.growth, fine_depth=self.fine_depth
        )

    def check_cavities(self, centres: Sequence[Vector]) -> None:
        """A pad has a cavity, and all at one height."""
        if not centres:
            raise wrong_value("a pad has at least one: add [[chamber]] with name and centre", key="chamber")
        for k, centre in enumerate(centres):
            if abs(centre[2] - centres[0][2]) > 1e-9:
                raise wrong_value(
                    "the cavities of a pad are all at one height", key=f"chamber[{k}].centre[2]"
                )


def pad_mesh(
    geometry: PadGeometry,
    surface_size: float,
    base_size: float,
    *,
    growth: float = 1.0,
    fine_depth: float = 0.0,
) -> TetMesh:
    """Linear tetrahedra of the pad, edges at the top at most surface_size m, grid boxes at most base_size m.

    The longest edge stays the same down to fine_depth m, then gains growth metres per metre; for another
    fineness, such as one around a known contact, see `block_mesh`. Raises MeshError when a length is not
    positive, a cavity reaches the surface, two cavities touch or their planes nearly coincide.
    """
    longest = finer_to_the_top(geometry.size[2], surface_size, growth=growth, fine_depth=fine_depth)
    if min(*geometry.size, *geometry.cavity_size) <= 0.0:
        raise MeshError("size and cavity_size must be positive")
    return block_mesh(geometry.block(), base_size, longest)
