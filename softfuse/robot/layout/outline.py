"""The outside of a body that holds cavities: a block from which notches are cut.

It stays as it is while the cavities change. Walls are measured from it: its six faces are planes, its notches
boxes.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.mesh.block import Block

SIDES = ("low x", "low y", "low z", "high x", "high y", "high z")
"""Names of a block's faces."""

NORMALS: Float[np.ndarray, "6 3"] = np.vstack([-np.eye(3), np.eye(3)])
"""Outward unit normals (6, 3) of its faces, in the order of SIDES."""


@dataclass(frozen=True, eq=False)
class Outline:
    """Lowest and highest corner (3,) m of a block, lowest and highest corners (n, 2, 3) m of its notches, and
    planes in m along x, y, z that its grid ought to have (see `mesh.block`).
    """

    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    notches: Float[np.ndarray, "n 2 3"]
    planes: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]

    @classmethod
    def of(cls, block: Block) -> "Outline":
        """The outside of a block, whatever its cavities."""
        return cls(block.low, block.high, block.notches, block.planes)

    def around(self, cavities: Float[np.ndarray, "k 2 3"]) -> Block:
        """The block with box-shaped cavities between their lowest and highest corners (k, 2, 3) m."""
        return Block(self.low, self.high, cavities, self.notches, self.planes)

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
