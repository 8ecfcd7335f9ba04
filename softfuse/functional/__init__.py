"""Scalars of the configuration: what sensors read and what actuators push against."""

from softfuse.functional.base import AbstractFunctional, Functional
from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.marker import Marker
from softfuse.functional.pressure_cells import PressureCells, flat_punch, uniform

__all__ = [
    "AbstractFunctional",
    "Cavity",
    "Contact",
    "ContactSurface",
    "Functional",
    "Marker",
    "PressureCells",
    "flat_punch",
    "uniform",
]
