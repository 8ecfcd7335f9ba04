"""Settings of what may touch a body: how it presses, and where on the surface it may."""

from abc import abstractmethod
from typing import Annotated, Literal, Self

import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Float, Int
from pydantic import Field

from softfuse.functional.chart import AbstractChart, FlatChart
from softfuse.functional.contact import ContactSurface
from softfuse.functional.pressure_cells import PressureCells, flat_punch, uniform
from softfuse.functional.skin import Skin
from softfuse.functional.workspace import AbstractWorkspace, FlatWorkspace, SurfaceWorkspace
from softfuse.io.quantity import (
    Angle,
    LayerCompliance,
    PositiveForce,
    PositiveInteger,
    PositiveLength,
)
from softfuse.io.settings import Direction, Range, Settings, Span
from softfuse.mechanics.indenters import FlatIndenter, SurfacePatches
from softfuse.mechanics.load import AbstractContact

_RINGS, _ANGLES = 3, 12
"""Quadrature points of a patch: across and around."""

_REACH = 2.5
"""Radii from a place within which its faces are sought: places may be a radius off a surface that is bent."""

_SPACING = 0.75
"""Of a contact's radius: how far apart places are looked at."""


class WorkspaceSettings(Settings):
    """Where the middle of a contact may be: ranges of x and y in m."""

    x: Range
    y: Range


class SurfaceSettings(Settings):
    """A part of the outer surface: points within these ranges (m, ends included) whose outward normal is
    within an `angle` of `normal` (3,); what is left out does not matter.
    """

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None
    normal: Direction | None = None
    angle: Annotated[Angle, Gt(0), Le(np.pi)] = np.pi / 2

    def holds(self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> np.ndarray:
        """Which points (n, 3) m of the surface with unit normals (n, 3) are in it."""
        inside = np.ones(len(points), bool)
        for axis, span in enumerate((self.x, self.y, self.z)):
            if span is not None:
                inside &= (points[:, axis] >= span[0]) & (points[:, axis] <= span[1])
        if self.normal is not None:
            along = normals @ np.array(self.normal) / np.linalg.norm(self.normal)
            inside &= along >= np.cos(self.angle)
        return inside


class ContactSettings(Settings):
    """Something of radius m that presses with at most max_force N, at_once at several places."""

    name: str
    radius: PositiveLength
    max_force: PositiveForce
    at_once: PositiveInteger = 1

    @abstractmethod
    def contact(self, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"]) -> AbstractContact:
        """The contact on the outward faces (f, s) of a body with nodes at `rest` (k, 3) m."""

    @abstractmethod
    def chart(self, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"]) -> AbstractChart | None:
        """The coordinates of its places on such faces; None on a surface that has none."""

    @abstractmethod
    def workspace(
        self, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"]
    ) -> AbstractWorkspace | None:
        """Where readings may say that it is; None where sensors alone say."""

    @property
    @abstractmethod
    def forces(self) -> int:
        """With how many forces one contact is driven."""

    @abstractmethod
    def real(self, skin: float) -> Self:
        """What really presses: one thing, through a further soft layer of a compliance [m/Pa]."""

    @property
    def ranges(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """The lowest and highest coordinates (2,) [m] in the chart."""
        return np.full(2, -np.inf), np.full(2, np.inf)


class DiscSettings(ContactSettings):
    """Discs that push along direction (3,) anywhere in the workspace.

    compliance in m/Pa: of a soft layer between disc and body, a padded indenter or a skin that the mesh does
    not have; 0: none.
    """

    direction: Direction
    within: WorkspaceSettings = Field(alias="workspace")
    compliance: Annotated[LayerCompliance, Ge(0)] = 0.0

    @staticmethod
    @abstractmethod
    def cells() -> PressureCells:
        """How its force may be distributed."""

    def contact(self, faces, rest):
        """A disc on those of the faces that look against its direction."""
        surface = ContactSurface.facing(faces, rest, np.array(self.direction))
        return FlatIndenter(surface, self.cells(), self.radius, self.compliance)

    def chart(self, faces, rest):
        """Across its direction, at the height of the outermost point of the faces."""
        flat = FlatChart.along(self.direction)
        outermost = np.min(np.asarray(rest)[np.unique(faces)] @ np.asarray(flat.direction))
        return FlatChart(outermost * flat.direction, flat.axes, flat.direction)

    def real(self, skin):
        """The same disc, through both layers."""
        return self.model_copy(update={"compliance": self.compliance + skin})

    @property
    def ranges(self):
        """Those of the workspace."""
        low, high = np.array([self.within.x, self.within.y]).T
        return low, high

    def workspace(self, faces, rest):
        """The rectangle."""
        return FlatWorkspace(self.chart(faces, rest), *self.ranges)

    @property
    def forces(self):
        """The total one."""
        return 1


class PunchSettings(DiscSettings):
    """A rigid flat indenter."""

    model: Literal["punch"]

    @staticmethod
    def cells():
        """Ring sectors whose forces follow from equal displacement."""
        return flat_punch()


class UniformSettings(DiscSettings):
    """The same pressure everywhere under the disc."""

    model: Literal["uniform"]

    @staticmethod
    def cells():
        """One cell."""
        return uniform()


class PatchSettings(ContactSettings):
    """Patches that press along the surface's current normal, at places that sensors see, or anywhere on a
    part of the outer surface.

    max_force bounds the force on each patch. span in m: two patches so far apart along a place's first
    tangent stand for one force anywhere between them; place_sigma in m: standard deviation of where it
    presses around the middle, None: anywhere.
    """

    model: Literal["patch"]
    surface: SurfaceSettings | None = None
    span: PositiveLength | None = None
    place_sigma: PositiveLength | None = None

    def contact(self, faces, rest):
        """One patch, or two at the ends of the span."""
        offsets = (0.0,) if self.span is None else (-0.5 * self.span, 0.5 * self.span)
        cells = uniform(rings=_RINGS, angles=_ANGLES)
        return SurfacePatches(Skin.of(faces, rest, _REACH * self.radius), cells, self.radius, offsets)

    def chart(self, faces, rest):
        """None."""
        del faces, rest
        return None

    def workspace(self, faces, rest):
        """Places all over its part of the surface."""
        if self.surface is None:
            return None
        return SurfaceWorkspace.over(rest, faces, self.surface.holds, _SPACING * self.radius)

    def real(self, skin):
        """One patch; its pressure is even, with a layer or without."""
        del skin
        return self.model_copy(update={"span": None})

    @property
    def forces(self):
        """One on each patch."""
        return 1 if self.span is None else 2


AnyContact = Annotated[PunchSettings | UniformSettings | PatchSettings, Field(discriminator="model")]
