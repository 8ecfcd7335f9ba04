"""Tables of pressure sensors on chambers, whose gas is sealed in, or which are driven to a pressure.

A part with an absolute, gauge or differential output, ratiometric or not, in volts or digital, is a straight
line between pressure and output; `data_sheets` holds the lines of common parts.
"""

from typing import Annotated, ClassVar, Literal, Self

import jax.numpy as jnp
import numpy as np
from annotated_types import Ge
from pydantic import AfterValidator, BeforeValidator, model_validator

from softfuse.io.quantity import (
    Dimension,
    Duration,
    Number,
    PositiveInteger,
    PositiveNumber,
    PositivePressure,
    PositiveTime,
    Pressure,
    PressureRate,
    wrong_value,
)
from softfuse.mechanics.reading import AnswerReading, DriveReading, JointReading
from softfuse.sensors.parameters import parameters
from softfuse.sensors.parts import ChamberPart
from softfuse.sensors.pressure.data_sheets import PRESSURE_PARTS
from softfuse.sensors.pressure.leak import LeakSettings
from softfuse.sensors.pressure.sensor import GaugePressure
from softfuse.sensors.tare import Tare, TareTimes
from softfuse.sensors.transfer import PartSettings, PositiveRaw, Raw

_SLOPE = Dimension("an output per pressure", "Pa^-1", "0.009 kPa^-1")

# Of virtual parts: bound of zeros in parts of `error`, spread of gains in parts of `gain_sigma`, drift of the
# gas in parts of the tare's.
_ZERO_BOUND, _GAIN_SIGMA, _DRIFT = 1.0, 0.5, 0.1


class TareSettings(TareTimes):
    """How zeros are taken. offset_sigma: standard deviation of the zero beforehand in Pa, None: the part's
    error; drift in Pa/s: 2 Pa/s is sealed gas that warms up by 0.35 K a minute.
    """

    offset_sigma: PositivePressure | None = None
    drift: Annotated[PressureRate, Ge(0)] = 2.0

    def tare(self, error_Pa: float) -> Tare:
        """How zeros of parts with that error [Pa] are taken."""
        sigma = error_Pa if self.offset_sigma is None else self.offset_sigma
        return parameters(Tare, self, offset_sigma_Pa=sigma)


def _ascending(values: tuple[float, float]) -> tuple[float, float]:
    if values[1] <= values[0]:
        raise wrong_value("the second value must be above the first")
    return values


class PressureSettings(PartSettings):
    """Pressure sensors on sealed or pressurised chambers.

    Channels carry (counts may be Pa) reference · (slope P + offset), or from `share` of the reference at the
    low end of the `range` in Pa to that at its high end. reference: the nominal supply of a `ratiometric`
    part, with reference_channel if it is measured, and reference_range in which the part works; 1 V of
    another, or the number of codes. absolute: against vacuum. error: of the zero in parts of the range;
    gain_sigma: relative error of each part; model_error: part of the largest change of a pressure by which
    every modelled one may be wrong. average: time constant in s; hold_off in s.
    """

    known_parts: ClassVar = PRESSURE_PARTS
    quantity: ClassVar = "pressure"
    errs_with_model: ClassVar = True

    type: Literal["pressure"] = "pressure"
    range: Annotated[tuple[Pressure, Pressure], AfterValidator(_ascending)]
    slope: Annotated[float, BeforeValidator(_SLOPE.parse)] | None = None
    offset: Number = 0.0
    share: tuple[Number, Number] | None = None
    absolute: bool = False
    ratiometric: bool = False
    reference: PositiveRaw
    reference_range: tuple[Raw, Raw] | None = None
    reference_channel: str | None = None
    error: PositiveNumber = 0.025
    gain_sigma: Annotated[Number, Ge(0)] = 0.01
    model_error: Annotated[Number, Ge(0)] = 0.05
    average: PositiveTime = 0.2
    hold_off: Duration = 1.0
    range_sigma: PositiveNumber = 5.0
    lag_frames: PositiveInteger = 10
    tare: TareSettings = TareSettings()
    leak: LeakSettings = LeakSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.low >= self.high:
            raise wrong_value(f"must be below high = {self.high:g}", key="low")
        if (self.slope is None) == (self.share is None):
            raise wrong_value("give either slope and offset, or share", key="slope")
        if self.reference_channel is not None and not self.ratiometric:
            raise wrong_value("only a ratiometric part is read against its supply", key="reference_channel")
        if self.reference_range and not self.reference_range[0] <= self.reference <= self.reference_range[1]:
            low, high = self.reference_range
            raise wrong_value(f"{self.reference:g} is not between {low:g} and {high:g}", key="reference")
        return self

    @property
    def columns(self):
        """Those of the chambers, then that of the reference."""
        return (*self.channels, *(() if self.reference_channel is None else (self.reference_channel,)))

    @property
    def line(self) -> tuple[float, float]:
        """Slope [1/Pa] and offset [-] of output over reference."""
        if self.slope is not None:
            return self.slope, self.offset
        assert self.share is not None  # one of both is given
        slope = (self.share[1] - self.share[0]) / (self.range[1] - self.range[0])
        return slope, self.share[0] - slope * self.range[0]

    def _tapped(self, parts) -> list[ChamberPart]:
        chambers = parts.chambers_of(self.name, self.chambers)
        for name, chamber in zip(self.chambers, chambers, strict=True):
            if chamber.drive is None:
                raise self._wrong(f'chamber "{name}" is vented, so that there is no pressure in it')
        return chambers

    def sensor(self, parts):
        """Raises ConfigError for a chamber that there is not, or that is vented."""
        chambers, k = self._tapped(parts), len(self.channels)
        (slope, offset), (low, high) = self.line, self.range
        span = self.error * (high - low)
        rest = parts.atmosphere if self.absolute else 0.0
        ends = self.reference_range if self.ratiometric and self.reference_range else (-np.inf, np.inf)

        def each(values):
            return jnp.broadcast_to(jnp.array(values, float), (k,))

        return parameters(
            GaugePressure,
            self,
            channels=self.columns,
            units=("Pa",) * k,
            chambers=tuple(name for name, made in zip(self.chambers, chambers, strict=True) if made.sealed),
            sealed=tuple(chamber.sealed for chamber in chambers),
            supplied=self.reference_channel is not None,
            gain_1_Pa=each(slope),
            offset=each(offset),
            rest_Pa=each(rest),
            # A good part that cannot read below its range may be off by its error there, at rest.
            low_Pa=each(low if self.absolute else low - span),
            high_Pa=each(high),
            lowest_gauge_Pa=each(low - rest),
            reference_low=ends[0],
            reference_high=ends[1],
            clip_low=self.low,
            clip_high=self.high,
            tare=self.tare.tare(span),
            leak=self.leak.test(),
            readings=self.readings,
            gain=each(self.gain),
            volume_m3=each([chamber.rest_volume + chamber.dead_volume for chamber in chambers]),
            atmosphere_Pa=each([chamber.atmosphere for chamber in chambers]),
            exponent=each([chamber.exponent for chamber in chambers]),
        )

    def functional(self, parts):
        """What answers the filling of sealed chambers, and what others are driven with."""
        kinds = {True: AnswerReading, False: DriveReading}
        return JointReading(tuple(kinds[chamber.sealed]((chamber.drive,)) for chamber in self._tapped(parts)))

    def ideal(self, parts, time_s, values):
        """Of gauge pressures (m, k) Pa, and the nominal reference."""
        slope, offset = self.line
        rest = parts.atmosphere if self.absolute else 0.0
        raw = self.reference * (slope * (rest + np.asarray(values)) + offset)
        if self.reference_channel is None:
            return raw
        return np.concatenate([raw, np.full((len(time_s), 1), self.reference)], axis=1)

    def electronics(self, parts, rng):
        """Parts that differ in zero and gain, gas that drifts, on the converter."""
        del parts
        per_Pa = self.reference * self.line[0]
        bound = _ZERO_BOUND * self.error * (self.range[1] - self.range[0]) * per_Pa
        one = np.arange(len(self.columns)) < len(self.channels)  # the reference is what it is
        return self._converted(
            gain=1.0 + one * rng.normal(0.0, _GAIN_SIGMA * self.gain_sigma, len(one)),
            zero=one * rng.uniform(-bound, bound, len(one)),
            drift=one * per_Pa * _DRIFT * self.tare.drift,
        )
