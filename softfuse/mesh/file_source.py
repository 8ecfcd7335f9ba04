"""Bodies that come from files: a closed surface that is filled, or a mesh."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Gt, Lt

from softfuse.errors import MeshError
from softfuse.io.quantity import LengthUnit, Number, PositiveLength
from softfuse.io.settings import ExistingFile, Vector
from softfuse.mesh.body_source import BodySource
from softfuse.mesh.chambers import hollowed
from softfuse.mesh.files import read_mesh, read_surface
from softfuse.mesh.shell import Shell
from softfuse.mesh.tetmesh import TetMesh
from softfuse.mesh.tetrahedralise import tetrahedralise

_NO_BLOCK = 'cavities are designed in a "pad", a "layout" or a "finger"'


class FileSource(BodySource):
    """A body in a file; unit: the file's unit of length."""

    file: ExistingFile
    unit: LengthUnit

    def chamber(self, file: Path) -> Shell:
        """The closed surface in another file of the same unit; see `read_surface` for the errors."""
        return read_surface(file, scale=self.unit)

    def outside(self):
        """Raises MeshError: it is no block."""
        raise MeshError(_NO_BLOCK)

    def fineness(self, boxes):
        """Raises MeshError as `outside` does."""
        raise MeshError(_NO_BLOCK)


class SurfaceSource(FileSource):
    """A closed surface (STL, OBJ, PLY, OFF) filled with tetrahedra; closed surfaces inside it are cavities.

    edge_length: of the tetrahedra, m; inserts: closed surfaces in the same unit, each a region of its own;
    envelope: how far straight edges may be from the surface, as a fraction of the body's diagonal, a
    twentieth of edge_length where it is left out.
    """

    edges: ClassVar[tuple[str, ...]] = ("edge_length",)

    type: Literal["surface"]
    edge_length: PositiveLength
    inserts: tuple[ExistingFile, ...] = ()
    envelope: Annotated[Number, Gt(0), Lt(1)] | None = None

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The surface filled, with the cavities that it has; see `tetrahedralise` for the errors."""
        inserts = [read_surface(path, scale=self.unit) for path in self.inserts]
        shell = read_surface(self.file, scale=self.unit)
        if chambers:
            shell = hollowed(shell, chambers)
        return tetrahedralise(shell, self.edge_length, inserts=inserts, envelope=self.envelope)


class MeshSource(FileSource):
    """A mesh of solid cells in a file (softfuse/mesh/files.py)."""

    type: Literal["mesh"]

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The mesh in the file, with the cavities that it has; see `read_mesh` for the errors."""
        return read_mesh(self.file, scale=self.unit)
