"""Numbers of the configuration: what sensors read and what actuators push against."""

from softfuse.functional.base import AbstractFunctional, Functional, MaterialFunctional
from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.curvature import Curvature
from softfuse.functional.embedded_line import EmbeddedLine
from softfuse.functional.embedded_sheet import EmbeddedSheet
from softfuse.functional.marker import Marker
from softfuse.functional.orientation import DirectionInPatch, PatchRotation
from softfuse.functional.point_pressure import PointPressure
from softfuse.functional.pressure_cells import PressureCells, flat_punch, uniform

__all__ = [
    "AbstractFunctional",
    "Cavity",
    "Contact",
    "ContactSurface",
    "Curvature",
    "DirectionInPatch",
    "EmbeddedLine",
    "EmbeddedSheet",
    "Functional",
    "Marker",
    "MaterialFunctional",
    "PatchRotation",
    "PointPressure",
    "PressureCells",
    "flat_punch",
    "uniform",
]
