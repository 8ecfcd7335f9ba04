"""Where the mesh of a body comes from: each kind has its settings beside what makes its mesh."""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.io.quantity import Length, Number, PositiveLength, millimetres
from softfuse.io.settings import Settings, Vector
from softfuse.mesh.block import Block, Fineness, finer_to_the_top, whole_block
from softfuse.mesh.shell import Shell
from softfuse.mesh.tetmesh import TetMesh

Size = tuple[PositiveLength, PositiveLength, PositiveLength]
"""Extents along x, y, z in m."""


class BodySource(Settings):
    """Where the mesh of a body comes from."""

    edges: ClassVar[tuple[str, ...]] = ()
    """Keys of the lengths of the mesh's edges."""

    @abstractmethod
    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The mesh, linear or not, of the body with cavities at these centres (k, 3) m, and with those whose
        walls come from files. Raises MeshError when there is no such mesh.
        """

    def chamber(self, file: Path) -> Shell:
        """The walls of a chamber in a file beside the body's; MeshError where the body has no file."""
        raise MeshError(f"a body of this type is drawn, not read: it has no chambers from files ({file})")

    def check_cavities(self, centres: Sequence[Vector]) -> None:
        """Raise the error of a validator when [[chamber]] asks for centres (k, 3) m that can never be."""

    @abstractmethod
    def outside(self) -> Block:
        """The block and its notches, without cavities, in which others may be designed; MeshError where the
        body is no such block.
        """

    @abstractmethod
    def fineness(self, boxes: Float[np.ndarray, "k 2 3"]) -> Fineness:
        """How fine the mesh of this outside is with cavities in boxes (k, 2, 3) m; errors: see `outside`."""

    def as_layout(self) -> dict[str, Any] | None:
        """The keys, for a file, of a "layout" with this outside and fineness, but for its shapes; None where
        it cannot be one.
        """


class BlockSource(BodySource):
    """A block of a size (3,) m with cavities where [[chamber]] says; z from 0 at its bottom, x and y centred.

    Lengths of the mesh's edges: at most surface_size m at the top and fine_depth m below it, growing by
    growth m per m from there; the grid under it has boxes of at most base_size m.
    """

    edges: ClassVar[tuple[str, ...]] = ("surface_size", "base_size")

    size: Size
    surface_size: PositiveLength
    base_size: PositiveLength
    growth: Annotated[Number, Ge(0)] = 1.0
    fine_depth: Annotated[Length, Ge(0)] = 0.0

    def outside(self) -> Block:
        """The whole block."""
        return whole_block(self.size)

    def fineness(self, boxes: Float[np.ndarray, "k 2 3"]) -> Fineness:
        """Finer to the top, wherever cavities are."""
        longest = finer_to_the_top(
            self.size[2], self.surface_size, growth=self.growth, fine_depth=self.fine_depth
        )
        return Fineness(self.base_size, longest)

    def as_layout(self) -> dict[str, Any]:
        """The same block, as fine."""
        return {
            "type": "layout",
            "size": [millimetres(length) for length in self.size],
            "surface_size": millimetres(self.surface_size),
            "fine_depth": millimetres(self.fine_depth),
            "growth": self.growth,
            "base_size": millimetres(self.base_size),
        }
