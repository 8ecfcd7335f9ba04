"""A dielectric elastomer strain sensor: the capacitance of a thin sheet in the material between two
electrodes.

C = ε ∫ da/(d s) = C₀ (a/a₀)/s̄, area a and mean stretch s̄ across the sheet, ε that of silicone, which does
not depend on strain. What is read is C/C₀ − 1. Source: O'Brien et al., Proc. SPIE 6524 (2007) 652415.
"""

from typing import ClassVar, Literal

import jax.numpy as jnp
import numpy as np

from softfuse.functional.base import MaterialFunctional
from softfuse.functional.embedded_sheet import EmbeddedSheet
from softfuse.io.quantity import PositiveCapacitance, PositiveNumber
from softfuse.io.settings import Vector
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.direct import Scaled, ScaledSettings


class SheetCapacitance(MaterialFunctional):
    """C/C₀ of a sheet."""

    sheet: EmbeddedSheet

    @property
    def nodes(self):
        """The sheet's."""
        return self.sheet.nodes

    def __call__(self, rest, displacement):
        """(a/a₀)/s̄ [-] (1,)."""
        area, stretch = self.sheet(rest, displacement)
        return jnp.atleast_1d(area / jnp.sum(self.sheet.weight) / stretch)


class SheetSettings(ScaledSettings):
    """A sheet: a parallelogram around `centre` (3,) m with two whole `edges` (3,) m; one channel, in `unit`.

    capacitance: at rest; noise: of a reading, offset_sigma: of the capacitance at rest, drift: of that per
    second, all relative to it.
    """

    channels_for: ClassVar = (1, "one sheet")

    type: Literal["dielectric-sheet"] = "dielectric-sheet"
    centre: Vector
    edges: tuple[Vector, Vector]
    capacitance: PositiveCapacitance
    unit: PositiveCapacitance = 1e-12
    noise: PositiveNumber = 5e-4
    offset_sigma: PositiveNumber = 0.05
    drift: PositiveNumber = 1e-5

    def _scaled(self, parts):
        """`functional` tells whether the sheet is in the body."""
        del parts
        factor = self.unit / self.capacitance
        return Scaled(("",), ("",), factor, 1.0, about=1.0, drift=self.drift)

    def functional(self, parts):
        """C/C₀ − 1. Raises MeshError for a sheet that leaves the body."""
        sheet = EmbeddedSheet.of(parts.body, np.array(self.centre), np.array(self.edges))
        return ShapeReading(SheetCapacitance(sheet))
