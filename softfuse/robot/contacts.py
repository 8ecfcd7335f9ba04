"""Settings of what may touch a body: how it presses, and where on the surface it may."""

from abc import abstractmethod
from typing import Annotated, Literal, Self

import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Float, Int
from pydantic import AfterValidator, Field, model_validator

from softfuse.functional.chart import FlatChart
from softfuse.functional.contact import ContactSurface
from softfuse.functional.pressure_cells import even, flat_punch, strip, uniform
from softfuse.functional.skin import Skin
from softfuse.functional.workspace import AbstractWorkspace, FlatWorkspace, SurfaceWorkspace
from softfuse.io.quantity import (
    Angle,
    LayerCompliance,
    Number,
    PositiveForce,
    PositiveInteger,
    PositiveLength,
    wrong_value,
)
from softfuse.io.settings import Direction, Range, Settings, Span
from softfuse.mechanics.indenters import (
    CylinderIndenter,
    FlatIndenter,
    SphereIndenter,
    Surface,
    SurfaceForce,
    SurfacePatches,
)
from softfuse.mechanics.load import AbstractContact

_RINGS, _ANGLES = 3, 12
"""Quadrature points of a patch: across and around."""

_STRIP = 6, 10
"""Cells of a cylinder along its axis and across."""

_REACH = 2.5
"""Radii from a place within which its faces are sought: places may be a radius off a surface that is bent."""

_SPACING = 0.75
"""Of a contact's radius: how far apart places are looked at."""


def _with_length(axis: tuple[float, float]) -> tuple[float, float]:
    if axis == (0.0, 0.0):
        raise wrong_value("the axis has no length; use [1, 0] for along u")
    return axis


Axis = Annotated[tuple[Number, Number], AfterValidator(_with_length)]
"""A vector (2,) of any length but 0 in a place's tangents u, v."""


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
    """Something of radius m that presses with at most max_force N, at_once at several places.

    Either along a direction (3,), its middle in a flat workspace; or along the normal of the outer surface,
    its middle on a part of that, {} being anywhere; or, with neither, so at places that sensors see.
    """

    name: str
    radius: PositiveLength
    max_force: PositiveForce
    at_once: PositiveInteger = 1
    direction: Direction | None = None
    within: WorkspaceSettings | None = Field(default=None, alias="workspace")
    surface: SurfaceSettings | None = None

    @abstractmethod
    def indenter(self, surface: Surface) -> AbstractContact:
        """What presses on a surface."""

    @abstractmethod
    def real(self, skin: float) -> "ContactSettings":
        """What really presses: one thing, through a further soft layer of a compliance [m/Pa]."""

    @property
    def reach(self) -> float:
        """How far from the middle of its place it may touch [m]."""
        return self.radius

    @property
    def layer(self) -> float | None:
        """Compliance [m/Pa] of a soft layer through which it presses, 0: none; None of what has no layer."""
        return None

    @property
    def line(self) -> tuple[float, float | None] | None:
        """Length [m] of a line along the first tangent of its place, anywhere on which it may press, and the
        standard deviation [m] around its middle, None: even; None of what presses at its place.
        """
        return None

    @property
    def bounds(self) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
        """The lowest and highest of the forces (d,) [N] that one contact is driven with."""
        return np.zeros(1), np.full(1, self.max_force)

    @property
    def ranges(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """The lowest and highest coordinates (2,) [m] in the chart."""
        if self.within is None:
            return np.full(2, -np.inf), np.full(2, np.inf)
        low, high = np.array([self.within.x, self.within.y]).T
        return low, high

    def contact(self, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"]) -> AbstractContact:
        """The contact on the outward faces (f, s) of a body with nodes at `rest` (k, 3) m."""
        if self.direction is not None:
            return self.indenter(ContactSurface.facing(faces, rest, np.array(self.direction)))
        return self.indenter(Skin.of(faces, rest, _REACH * self.reach))

    def chart(self, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"]) -> FlatChart | None:
        """The coordinates of its places on such faces: across its direction, at the height of the outermost
        point; None on a surface that has none.
        """
        if self.direction is None:
            return None
        flat = FlatChart.along(self.direction)
        outermost = np.min(np.asarray(rest)[np.unique(faces)] @ np.asarray(flat.direction))
        return FlatChart(outermost * flat.direction, flat.axes, flat.direction)

    def workspace(
        self, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"]
    ) -> AbstractWorkspace | None:
        """Where readings may say that it is; None where sensors alone say."""
        chart = self.chart(faces, rest)
        if chart is not None:
            return FlatWorkspace(chart, *self.ranges)
        if self.surface is None:
            return None
        return SurfaceWorkspace.over(rest, faces, self.surface.holds, _SPACING * self.radius)

    @model_validator(mode="after")
    def _check_where(self) -> Self:
        if (self.direction is None) != (self.within is None):
            pair = ("direction", "workspace")
            missing, there = pair if self.direction is None else pair[::-1]
            raise wrong_value(f"missing, needed with {there}", key=missing)
        if self.direction is not None and self.surface is not None:
            raise wrong_value("give either a direction and a workspace or a surface", key="surface")
        return self


class DiscSettings(ContactSettings):
    """A flat disc.

    compliance in m/Pa: of a soft layer between disc and body, a padded indenter or a skin that the mesh does
    not have; 0: none.
    """

    compliance: Annotated[LayerCompliance, Ge(0)] = 0.0

    @property
    def layer(self):
        """As configured."""
        return self.compliance

    def real(self, skin):
        """The same disc, through both layers."""
        return self.model_copy(update={"compliance": self.compliance + skin})


class PunchSettings(DiscSettings):
    """A rigid flat indenter, with ring sectors whose forces follow from equal displacement."""

    model: Literal["punch"]

    def indenter(self, surface):
        """The disc."""
        return FlatIndenter(surface, flat_punch(), self.radius, self.compliance)


class UniformSettings(DiscSettings):
    """The same pressure everywhere under the disc."""

    model: Literal["uniform"]

    def indenter(self, surface):
        """The disc, with one cell."""
        return FlatIndenter(surface, uniform(), self.radius, self.compliance)


class RoundSettings(ContactSettings):
    """A rigid round thing.

    extent in m: how far aside from its middle it may touch; None: its radius. A smaller one tells small loads
    apart better: so far reach its pressure cells.
    """

    extent: PositiveLength | None = None

    @property
    def reach(self):
        """The extent."""
        return self.extent or self.radius

    def real(self, skin):
        """The same thing; what is round presses through no layer."""
        del skin
        return self


class SphereSettings(RoundSettings):
    """A rigid sphere."""

    model: Literal["sphere"]

    def indenter(self, surface):
        """The sphere."""
        return SphereIndenter(surface, even(), self.radius, self.reach)


class CylinderSettings(RoundSettings):
    """A rigid cylinder of a length m along an axis (2,), of any length but 0, in a place's tangents u, v."""

    model: Literal["cylinder"]
    length: PositiveLength
    axis: Axis = (1.0, 0.0)

    @property
    def reach(self):
        """To the corners of the strip where it may touch."""
        return float(np.hypot(0.5 * self.length, self.extent or self.radius))

    def indenter(self, surface):
        """The cylinder, whose unit is half its length."""
        half = 0.5 * self.length
        cells = strip((self.extent or self.radius) / half, *_STRIP)
        return CylinderIndenter(surface, cells, self.radius, half, np.array(self.axis) / np.hypot(*self.axis))


class PatchSettings(ContactSettings):
    """Patches that press along the surface's current normal.

    max_force bounds the force on each patch. span in m: two patches so far apart along a place's first
    tangent stand for one force anywhere between them; place_sigma in m: standard deviation of where it
    presses around the middle, None: anywhere.
    """

    model: Literal["patch"]
    span: PositiveLength | None = None
    place_sigma: PositiveLength | None = None

    @property
    def line(self):
        """The span."""
        return None if self.span is None else (self.span, self.place_sigma)

    def indenter(self, surface):
        """One patch, or two at the ends of the span."""
        offsets = (0.0,) if self.span is None else (-0.5 * self.span, 0.5 * self.span)
        return SurfacePatches(surface, uniform(rings=_RINGS, angles=_ANGLES), self.radius, offsets)

    def real(self, skin):
        """One patch; its pressure is even, with a layer or without."""
        del skin
        return self.model_copy(update={"span": None})

    @property
    def bounds(self):
        """Of one on each patch."""
        patches = 1 if self.span is None else 2
        return np.zeros(patches), np.full(patches, self.max_force)


class ForceSettings(ContactSettings):
    """A patch that is pushed in any direction: along the surface's current normal, and along its tangents to
    either side with as much.
    """

    model: Literal["force"]

    def indenter(self, surface):
        """The patch."""
        return SurfaceForce(surface, uniform(rings=_RINGS, angles=_ANGLES), self.radius)

    def real(self, skin):
        """A patch that presses along the normal."""
        del skin
        given = {key: getattr(self, key) for key in ContactSettings.model_fields}
        return PatchSettings.model_construct(**given, model="patch")

    @property
    def bounds(self):
        """Of the normal force, then of those along u and v."""
        return self.max_force * np.array([0.0, -1.0, -1.0]), np.full(3, self.max_force)


AnyContact = Annotated[
    PunchSettings | UniformSettings | SphereSettings | CylinderSettings | PatchSettings | ForceSettings,
    Field(discriminator="model"),
]
