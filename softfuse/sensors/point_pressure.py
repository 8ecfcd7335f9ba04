"""A barometer cast into the material: the hydrostatic pressure at a point, as TakkTile sensors read it.

The chip and its cavity concentrate the stress around themselves: `gain` is what is measured over what the
material alone would have, to be calibrated. The atmosphere and the stress of casting are in the zero.
"""

from typing import Annotated, ClassVar, Literal

from annotated_types import Ge
from pydantic import BeforeValidator

from softfuse.body.body import Body
from softfuse.functional.point_pressure import PointPressure
from softfuse.io.quantity import (
    Dimension,
    PositiveLength,
    PositiveNumber,
    PositivePressure,
    PressureRate,
)
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.direct import Scaled, ScaledSettings

_PER_READING = Dimension("a pressure", "Pa", "1 Pa")


class PointPressureSettings(ScaledSettings):
    """A barometer at a [[point]], over a ball of `radius` in m; one channel, `unit` of pressure for each one
    of it.

    noise, offset_sigma: of a reading and of its zero in Pa, drift of that per second in Pa/s.
    """

    channels_for: ClassVar = (1, "one barometer")

    type: Literal["point-pressure"] = "point-pressure"
    point: str
    radius: PositiveLength = 2e-3
    unit: Annotated[float, BeforeValidator(_PER_READING.parse)] = 1.0
    gain: PositiveNumber = 1.0
    noise: PositivePressure = 5.0
    offset_sigma: PositivePressure = 2e3
    drift: Annotated[PressureRate, Ge(0)] = 2.0

    def _scaled(self, parts):
        """Raises ConfigError for a point that there is not."""
        parts.point_of(self.name, self.point)
        rest, size = parts.atmosphere / self.gain, 1.0 / self.gain
        return Scaled(("",), ("Pa",), self.unit * size, rest, size, about=rest, drift=self.drift)

    def functional(self, parts):
        """The pressure beyond that at rest. Raises MeshError where the ball reaches out of the body."""
        at = parts.point_of(self.name, self.point)
        if not isinstance(parts.body, Body):
            raise self._wrong("the pressure of the material is read in the full body, not in a reduced one")
        return ShapeReading(PointPressure.of(parts.body, at, self.radius))
