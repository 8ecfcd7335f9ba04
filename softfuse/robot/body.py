"""The body: where its mesh comes from, what it is made of, where it is held."""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BeforeValidator, Field, model_validator

from softfuse.body.stiffness_field import TERMS
from softfuse.errors import MeshError
from softfuse.io.quantity import Acceleration, Length, LengthUnit, Number, PositiveLength, wrong_value
from softfuse.io.settings import ExistingFile, NotEmpty, Settings, Span, Vector, listed
from softfuse.mesh.chambers import hollowed
from softfuse.mesh.drawing import AbstractBlockDrawing
from softfuse.mesh.files import read_mesh, read_surface
from softfuse.mesh.finger import FingerGeometry, finger_mesh
from softfuse.mesh.pad import PadGeometry
from softfuse.mesh.shell import Shell
from softfuse.mesh.tetmesh import TetMesh
from softfuse.mesh.tetrahedralise import tetrahedralise
from softfuse.robot.chamber_shapes import AnyCavityShape
from softfuse.robot.layout.layout_drawing import LayoutDrawing
from softfuse.robot.material import Material

Size = tuple[PositiveLength, PositiveLength, PositiveLength]
"""Extents along x, y, z in m."""


class BodySource(Settings):
    """Where the mesh of a body comes from."""

    edges: ClassVar[tuple[str, ...]] = ()
    """Keys of the lengths of the mesh's edges."""

    def finer(self, times: float) -> Self:
        """The same with so many times shorter edges."""
        return self.model_copy(update={key: getattr(self, key) / times for key in self.edges})

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

    @abstractmethod
    def drawing(self, cavity_centres: Sequence[Vector]) -> AbstractBlockDrawing:
        """The block with cavities at these centres (k, 3) m, which `check_cavities` has seen."""

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The drawing's, as fine as configured."""
        return self.drawing(cavity_centres).mesh(
            self.surface_size, self.base_size, growth=self.growth, fine_depth=self.fine_depth
        )


class PadSource(BlockSource):
    """A block with equal box-shaped cavities of a cavity_size (3,) m, all at the same height
    (softfuse/mesh/pad.py).
    """

    type: Literal["pad"]
    cavity_size: Size

    def drawing(self, cavity_centres):
        """The pad with cavities at the centres (k, 3) m."""
        return PadGeometry(
            size=self.size,
            cavity_size=self.cavity_size,
            cavity_centres=tuple(centre[:2] for centre in cavity_centres),
            cavity_z_bottom=cavity_centres[0][2] - 0.5 * self.cavity_size[2],
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


class LayoutSource(BlockSource):
    """A block with cavities of any shape, each with a table in the order of [[chamber]], which has its centre
    (softfuse/design/layout_drawing.py).
    """

    type: Literal["layout"]
    shapes: Annotated[tuple[AnyCavityShape, ...], NotEmpty] = Field(alias="shape")

    def drawing(self, cavity_centres):
        """The layout with cavities at the centres (k, 3) m."""
        parts = zip(self.shapes, cavity_centres, strict=True)
        return LayoutDrawing(
            size=self.size,
            cavities=tuple((each.shape, tuple(each.values(centre).values())) for each, centre in parts),
        )

    def check_cavities(self, centres: Sequence[Vector]) -> None:
        """There are as many shapes as cavities."""
        if len(self.shapes) != len(centres):
            raise wrong_value(
                f"{len(self.shapes)} shapes for {len(centres)} cavities: give one for each [[chamber]], in "
                "their order",
                key="body.source.shape",
            )


class FingerSource(BodySource):
    """A beam with necks and equal box-shaped cavities (softfuse/mesh/finger.py).

    x from the clamped base (0) to the tip, y centred, z from the palm (0) to the back. size, cavity_size:
    (3,) m; neck_x: middles (n,) m of the necks along x; a neck is neck_length m long and reaches from the
    back down to neck_height m below it. The cavities stand where [[chamber]] says. Lengths of the mesh's
    edges: at most wall_size m around the cavities, growing by growth m per m from there; the grid under it
    has boxes of at most base_size m.
    """

    edges: ClassVar[tuple[str, ...]] = ("wall_size", "base_size")

    type: Literal["finger"]
    size: Size
    neck_x: Annotated[tuple[PositiveLength, ...], NotEmpty]
    neck_length: PositiveLength
    neck_height: PositiveLength
    cavity_size: Size
    wall_size: PositiveLength
    base_size: PositiveLength
    growth: Annotated[Number, Ge(0)] = 2.0

    def geometry(self, cavity_centres: Sequence[Vector]) -> FingerGeometry:
        """The finger with cavities at the centres (k, 3) m."""
        return FingerGeometry(
            size=self.size,
            neck_x=self.neck_x,
            neck_length=self.neck_length,
            neck_height=self.neck_height,
            cavity_size=self.cavity_size,
            cavity_centres=tuple(cavity_centres),
        )

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The same, meshed; see `finger_mesh` for the errors."""
        geometry = self.geometry(cavity_centres)
        return finger_mesh(geometry, self.wall_size, self.base_size, growth=self.growth)


class FileSource(BodySource):
    """A body in a file; unit: the file's unit of length."""

    file: ExistingFile
    unit: LengthUnit

    def chamber(self, file: Path) -> Shell:
        """The closed surface in another file of the same unit; see `read_surface` for the errors."""
        return read_surface(file, scale=self.unit)


class SurfaceSource(FileSource):
    """A closed surface (STL, OBJ, PLY, OFF) filled with tetrahedra; closed surfaces inside it are cavities.

    edge_length: of the tetrahedra, m; inserts: closed surfaces in the same
    unit, each a region of its own; envelope: how far straight edges may be from the surface, as a fraction of
    the body's diagonal, a twentieth of edge_length where it is left out.
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


Source = Annotated[
    PadSource | LayoutSource | FingerSource | SurfaceSource | MeshSource, Field(discriminator="type")
]


class FixedSettings(Settings):
    """Nodes within these ranges (m, ends included) cannot move; an axis that is left out does not matter.

    group: a named group of the mesh's file, one of several where a list is given: what is in one of them and
    in the ranges, if there are any (softfuse/mesh/groups.py).
    """

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None
    group: Annotated[tuple[str, ...], NotEmpty, BeforeValidator(listed)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.x is None and self.y is None and self.z is None and self.group is None:
            raise wrong_value('give a range of x, y or z, such as z = ["0 mm", "0 mm"], or a group')
        return self


_Coefficient = Annotated[Number, Ge(-3), Le(3)]


class StiffnessFieldSettings(Settings):
    """Coefficients [-] of ln of how many times as stiff as its materials the body is, from place to place
    (softfuse/body/stiffness_field.py).
    """

    x: _Coefficient = 0.0
    y: _Coefficient = 0.0
    z: _Coefficient = 0.0
    xy: _Coefficient = 0.0
    xz: _Coefficient = 0.0
    yz: _Coefficient = 0.0
    xx: _Coefficient = 0.0
    yy: _Coefficient = 0.0
    zz: _Coefficient = 0.0

    @property
    def coefficients(self) -> tuple[float, ...]:
        """(9,) [-], as `with_field` takes them."""
        return tuple(getattr(self, term) for term in TERMS)

    @property
    def some(self) -> bool:
        """Whether any is not 0."""
        return any(self.coefficients)


class BodySettings(Settings):
    """Mesh, element, materials, how stiff they are from place to place, held nodes and gravity (3,) m/s².

    There is one material for each region of the mesh, in ascending order of the regions' numbers.
    """

    element: Literal["taylor-hood", "quadratic", "linear"] = "taylor-hood"
    source: Source
    materials: Annotated[tuple[Material, ...], NotEmpty] = Field(alias="material")
    # Without a field it is left out of digests, so that charts made before there were fields are still good.
    stiffness_field: StiffnessFieldSettings = Field(
        default=StiffnessFieldSettings(), exclude_if=lambda field: not field.some
    )
    fixed: FixedSettings
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_pressure(self) -> Self:
        for k, material in enumerate(self.materials):
            if self.element == "taylor-hood" and material.lame <= 0.0:
                raise wrong_value(
                    f"Lamé's λ is {material.lame:.4g} Pa: a Taylor-Hood element needs a positive one; "
                    'raise poisson or bulk, or set body.element = "quadratic"',
                    key=f"material[{k}]",
                )
        return self
