"""A dielectric elastomer strain sensor: the capacitance of a thin sheet in the material between two
electrodes.

C = ε ∫ da/(d s) = C₀ (a/a₀)/s̄, area a and mean stretch s̄ across the sheet, ε that of silicone, which does
not depend on strain. What is read is C/C₀ − 1. Source: O'Brien et al., Proc. SPIE 6524 (2007) 652415.
"""

from typing import Literal

import jax.numpy as jnp
import numpy as np

from softfuse.functional.base import MaterialFunctional
from softfuse.functional.embedded_sheet import EmbeddedSheet
from softfuse.io.quantity import PositiveCapacitance, PositiveNumber, wrong_value
from softfuse.io.settings import Vector
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.direct import DirectSettings, Scale
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.parts import Parts

_DRIFT_TIME_S = 600.0
"""How long a virtual capacitance drifts one way."""


class SheetCapacitance(MaterialFunctional):
    """C/C₀ of a sheet."""

    sheet: EmbeddedSheet

    def __call__(self, rest, displacement):
        """(a/a₀)/s̄ [-] (1,)."""
        area, stretch = self.sheet(rest, displacement)
        return jnp.atleast_1d(area / jnp.sum(self.sheet.weight) / stretch)


class SheetSettings(DirectSettings):
    """A sheet: a parallelogram around `centre` (3,) m with two whole `edges` (3,) m; one channel, in `unit`.

    capacitance: at rest; noise: of a reading, offset_sigma: of the capacitance at rest, drift: of that per
    second, all relative to it.
    """

    type: Literal["dielectric-sheet"] = "dielectric-sheet"
    centre: Vector
    edges: tuple[Vector, Vector]
    capacitance: PositiveCapacitance
    unit: PositiveCapacitance = 1e-12
    noise: PositiveNumber = 5e-4
    offset_sigma: PositiveNumber = 0.05
    drift: PositiveNumber = 1e-5

    def model_post_init(self, context, /) -> None:
        """Raise the error of a validator unless there is one channel."""
        if len(self.channels) != 1:
            raise wrong_value(f"{len(self.channels)} for one sheet", key="channels")

    def _sheet(self, parts: Parts) -> SheetCapacitance:
        return SheetCapacitance(EmbeddedSheet.of(parts.body, np.array(self.centre), np.array(self.edges)))

    def sensor(self, parts):
        """The filter; `functional` tells whether the sheet is in the body."""
        del parts
        return self._direct(
            ("",),
            Scale(jnp.asarray(self.unit / self.capacitance, float)),
            1.0,
            units=("",),
            noise=self.noise,
            offset_sigma=self.offset_sigma,
            drift=self.drift,
        )

    def functional(self, parts):
        """C/C₀ − 1. Raises MeshError for a sheet that leaves the body."""
        return ShapeReading(self._sheet(parts))

    def ideal(self, parts, time_s, values):
        """Of relative changes (m, 1)."""
        del parts, time_s
        return (1.0 + np.asarray(values)) * self.capacitance / self.unit

    def electronics(self, parts, rng):
        """A sheet that is off at rest and in gain."""
        del parts
        whole = self.capacitance / self.unit
        return equal_channels(
            1,
            nothing=whole,
            gain=self._gains(rng, 1),
            zero=rng.normal(0.0, self.offset_sigma, 1) * whole,
            slow_sigma=self.drift * _DRIFT_TIME_S * whole,
            slow_time=_DRIFT_TIME_S,
            noise=self.noise * whole,
        )
