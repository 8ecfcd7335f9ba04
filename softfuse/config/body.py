"""The body: where its mesh comes from, what it is made of, where it is held."""

from typing import Annotated, Literal, Self

from annotated_types import Ge, Gt, Lt
from pydantic import Field, model_validator

from softfuse.config.material import Material
from softfuse.config.quantity import Acceleration, Length, LengthUnit, Number, PositiveLength, wrong_value
from softfuse.config.settings import ExistingFile, NotEmpty, Settings, Span

Size = tuple[PositiveLength, PositiveLength, PositiveLength]
"""Extents along x, y, z in m."""


class PadSource(Settings):
    """A block with equal box-shaped cavities; z from 0 at its bottom, x and y centred (softfuse/mesh/pad.py).

    size, cavity_size: (3,) m. The cavities stand where [[cavity]] says, all at the same height. Lengths of
    the mesh's edges: at most surface_size m at the top and fine_depth m below it, growing by growth m per m
    from there; the grid under it has boxes of at most base_size m.
    """

    type: Literal["pad"]
    size: Size
    cavity_size: Size
    surface_size: PositiveLength
    base_size: PositiveLength
    growth: Annotated[Number, Ge(0)] = 1.0
    fine_depth: Annotated[Length, Ge(0)] = 0.0


class SurfaceSource(Settings):
    """A closed surface (STL, OBJ, PLY, OFF) filled with tetrahedra; closed surfaces inside it are cavities.

    unit: the file's unit of length; edge_length: of the tetrahedra, m; inserts: closed surfaces in the same
    unit, each a region of its own; envelope: how far the mesh may be from the surface, as a fraction of the
    body's diagonal.
    """

    type: Literal["surface"]
    file: ExistingFile
    unit: LengthUnit
    edge_length: PositiveLength
    inserts: tuple[ExistingFile, ...] = ()
    envelope: Annotated[Number, Gt(0), Lt(1)] = 1e-3


class MeshSource(Settings):
    """A tetrahedral mesh in any format that meshio reads; unit: the file's unit of length."""

    type: Literal["mesh"]
    file: ExistingFile
    unit: LengthUnit


Source = Annotated[PadSource | SurfaceSource | MeshSource, Field(discriminator="type")]


class FixedSettings(Settings):
    """Nodes within these ranges (m, ends included) cannot move; an axis that is left out does not matter."""

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.x is None and self.y is None and self.z is None:
            raise wrong_value('give a range of x, y or z, such as z = ["0 mm", "0 mm"]')
        return self


class BodySettings(Settings):
    """Mesh, element, materials, held nodes and gravity (3,) m/s².

    There is one material for each region of the mesh, in ascending order of the regions' numbers.
    """

    element: Literal["taylor-hood", "quadratic", "linear"] = "taylor-hood"
    source: Source
    materials: Annotated[tuple[Material, ...], NotEmpty] = Field(alias="material")
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
