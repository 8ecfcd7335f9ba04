"""Pressure sensors on chambers: the gauge pressure of gas that is sealed in, or to which a chamber is driven.

A part with an absolute, gauge or differential output, ratiometric or not, in volts or digital, is a straight
line between pressure and output; `data_sheets` holds the lines of common parts. What is measured is averaged
over `average` by an exponential mean, which leaves σ √(dt / 2τ) of the noise and lags τ behind: shapes are
slow, noise is not. To the noise of the pressures comes the error of the modelled ones: a part `model_error`
of the largest change among all chambers, for what the model misses of one way of bending is seen in every
chamber. While something is near, changes count from the last frame before: what the model misses of the shape
before is known (`estimation.model_offset`).
"""

from typing import Annotated, Any, ClassVar, Literal, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from annotated_types import Ge
from jaxtyping import Array, Bool, Float
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
from softfuse.io.settings import Settings
from softfuse.mechanics.reading import AnswerReading, DriveReading, JointReading
from softfuse.sensors.base import AbstractSensor, Hint, Measurement, VolumeChange
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.gas import volume_change_of
from softfuse.sensors.parts import ChamberPart
from softfuse.sensors.pressure.data_sheets import PRESSURE_PARTS
from softfuse.sensors.pressure.filter import (
    PressureReading,
    PressureSensor,
    PressureState,
    pressure_init,
    pressure_update,
)
from softfuse.sensors.pressure.leak import LeakSettings
from softfuse.sensors.tare import Tare
from softfuse.sensors.transfer import PartSettings, PositiveRaw, Raw, of_part

_SLOPE = Dimension("an output per pressure", "Pa^-1", "0.009 kPa^-1")

# Of virtual parts: bound of zeros in parts of `error`, spread of gains in parts of `gain_sigma`, drift of the
# gas
# in parts of the tare's, and how long it drifts one way.
_ZERO_BOUND, _GAIN_SIGMA, _DRIFT, _DRIFT_TIME_S = 1.0, 0.5, 0.1, 600.0


class TareSettings(Settings):
    """How zeros are taken: standard deviations in Pa and Pa/s, times in s, a limit in standard deviations.

    offset_sigma: of the zero beforehand, None: the part's error. 2 Pa/s of drift is sealed gas that warms up
    by 0.35 K a minute.
    """

    offset_sigma: PositivePressure | None = None
    drift: Annotated[PressureRate, Ge(0)] = 2.0
    settle: PositiveTime = 1.0
    follow: PositiveTime = 5.0
    gate_sigma: PositiveNumber = 5.0
    relearn: PositiveTime = 5.0

    def tare(self, error_Pa: float) -> Tare:
        """How zeros of parts with that error [Pa] are taken."""
        sigma = error_Pa if self.offset_sigma is None else self.offset_sigma
        return Tare(
            offset_sigma_Pa=jnp.asarray(sigma, float),
            drift_Pa_s=jnp.asarray(self.drift, float),
            settle_s=jnp.asarray(self.settle, float),
            follow_s=jnp.asarray(self.follow, float),
            gate_sigma=jnp.asarray(self.gate_sigma, float),
            relearn_s=jnp.asarray(self.relearn, float),
        )


class GasState(eqx.Module):
    """Memory between frames: of the sensors, of their means (k,) [Pa], and of these when nothing was near."""

    pressure: PressureState
    mean_Pa: Float[Array, " k"]
    mean_known: Bool[Array, " k"]
    clear_Pa: Float[Array, " k"]


class GaugePressure(AbstractSensor):
    """Pressure sensors with one set of constants, on k chambers.

    `gain` (k,) [-]: measured over modelled pressures; `model_error` [-], `average_s` [s]: see above; `sealed`
    (k,): the gas does not escape, so that its pressure tells the volume, of chamber and dead volume
    `volume_m3` (k,) under `atmosphere_Pa` (k,) with the exponent (k,); `supplied`: the last channel is the
    reference.
    """

    name: str = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    readings: tuple[str, ...] = eqx.field(static=True)
    tapped: tuple[str, ...] = eqx.field(static=True)
    sealed: tuple[bool, ...] = eqx.field(static=True)
    supplied: bool = eqx.field(static=True)
    filter: PressureSensor
    gain: Float[Array, " k"]
    model_error: Float[Array, ""]
    average_s: Float[Array, ""]
    volume_m3: Float[Array, " k"]
    atmosphere_Pa: Float[Array, " k"]
    exponent: Float[Array, " k"]

    @property
    def chambers(self):
        """Those whose gas is sealed in."""
        return tuple(name for name, sealed in zip(self.tapped, self.sealed, strict=True) if sealed)

    @property
    def units(self):
        """Pressures."""
        return ("Pa",) * len(self.readings)

    def init(self):
        """At rest."""
        k = len(self.tapped)
        return GasState(pressure_init(self.filter), jnp.zeros(k), jnp.zeros(k, bool), jnp.zeros(k))

    def hint(self, state):
        """By how much the mean over the lag is above the zero, of sealed gas."""
        here = np.flatnonzero(self.sealed)
        if not here.size:
            return None
        yes = jnp.ones(here.size, bool)
        return Hint(_excess(self.filter, state.pressure)[here], yes, yes)

    def driven(self, state, raw):
        """Whether a chamber that is not sealed has another pressure than at rest."""
        here = np.flatnonzero(~np.array(self.sealed))
        excess = _excess(self.filter, state.pressure)[here]
        return jnp.any(jnp.abs(excess) > self.filter.tare.gate_sigma)

    def update(self, state, frame, raw, context):
        """Raw readings, and the reference as the last of them where it is measured; `details`:
        PressureReading.
        """
        k = len(self.tapped)
        reference = raw[k] if self.supplied else jnp.asarray(jnp.nan)
        later, seen = pressure_update(
            self.filter, state.pressure, frame.dt_s, raw[:k], reference, context.resting
        )
        mean, known, noise = self._averaged(state, frame.dt_s, seen)
        # The pressure of a chamber that leaks is true, but no longer that of the gas it was sealed with.
        leaking = seen.leaking & jnp.asarray(self.sealed)
        valid = seen.valid & known & ~leaking
        change = mean - jnp.where(context.clear, 0.0, state.clear_Pa)
        missed = self.model_error * jnp.max(jnp.where(valid, jnp.abs(change), 0.0))
        sigma = jnp.hypot(noise, missed)
        flags = {
            f"{self.name} missing": jnp.any(seen.missing),
            f"{self.name} out of range": jnp.any(seen.out_of_range),
            f"{self.name} leaks": jnp.any(leaking),
        }
        clear = jnp.where(context.clear, mean, state.clear_Pa)
        told = self._volume(mean / self.gain, valid) if any(self.sealed) else None
        return GasState(later, mean, known, clear), Measurement(
            mean / self.gain, sigma / self.gain, valid, flags, None, told, seen
        )

    def _averaged(
        self, state: GasState, dt: Float[Array, ""], seen: PressureReading
    ) -> tuple[Array, Array, Array]:
        """Mean pressure (k,) [Pa], whether it is known (k,), and its standard deviation (k,) [Pa]."""
        share = 1 - jnp.exp(-dt / self.average_s)
        moved = state.mean_Pa + share * (seen.gauge_Pa - state.mean_Pa)
        fresh = jnp.where(state.mean_known, moved, seen.gauge_Pa)
        mean = jnp.where(seen.valid, fresh, state.mean_Pa)
        noise = self.filter.noise / self.filter.reference / self.filter.gain_1_Pa
        left = noise**2 * share / (2 - share)
        rest = jnp.maximum(seen.sigma_Pa**2 - noise**2, 0.0)
        return mean, state.mean_known | seen.valid, jnp.sqrt(rest + left)

    def _volume(self, gauge_Pa: Float[Array, " k"], valid: Bool[Array, " k"]) -> VolumeChange:
        """Changes of the volumes of sealed gas."""
        here = np.flatnonzero(self.sealed)
        least = -0.99 * self.atmosphere_Pa[here]
        change = volume_change_of(
            jnp.maximum(gauge_Pa[here], least),
            self.volume_m3[here],
            jnp.zeros(here.size),
            atmosphere=self.atmosphere_Pa[here],
            exponent=self.exponent[here],
        )
        return VolumeChange(change, valid[here])


def _excess(sensor: PressureSensor, state: PressureState) -> Float[Array, " k"]:
    """Mean pressure (k,) over the lag above the zero, in standard deviations; 0 before the zero is known."""
    noise = sensor.noise / (sensor.reference * sensor.gain_1_Pa)
    usable = state.lag_usable
    count = jnp.sum(usable, axis=0)
    mean = jnp.sum(jnp.where(usable, state.lag_Pa, 0.0), axis=0) / jnp.maximum(count, 1)
    drifted = sensor.tare.drift_Pa_s * state.tare.unseen_s
    variance = state.tare.variance_Pa2 + drifted**2 + noise**2 / jnp.maximum(count, 1)
    known = (state.tare.averaged_s >= sensor.tare.settle_s) & (count > 0)
    return jnp.where(known, (mean - state.tare.zero_Pa) / jnp.sqrt(variance), 0.0)


def _ascending(values: tuple[float, float]) -> tuple[float, float]:
    if values[1] <= values[0]:
        raise wrong_value("the second value must be above the first")
    return values


class PressureSettings(PartSettings):
    """Pressure sensors on sealed or pressurised chambers, one channel for each; keys left out are the
    `part`'s.

    output: what channels carry, "volts" or "counts" (or Pa of a digital part); output = reference · (slope P
    + offset), or from `share` of the reference at the low end of the `range` in Pa to that at its high end.
    reference: the nominal supply of a `ratiometric` part, with reference_channel if it is measured, and
    reference_range in which the part works; 1 V of another, or the number of codes. absolute: against vacuum.
    low, high: readings at or beyond are clipped; noise of a reading; error of the zero in parts of the range;
    bits, full_scale of the converter. gain [-]: what is measured over what the model says, one value or one
    for each chamber; gain_sigma: relative error of each part; model_error: part of the largest change of a
    pressure by which every modelled one may be wrong. average: time constant in s; hold_off in s.
    """

    quantity: ClassVar[str] = "pressure"

    type: Literal["pressure"] = "pressure"
    part: str | None = None
    output: Literal["volts", "counts"] = "volts"
    range: Annotated[tuple[Pressure, Pressure], AfterValidator(_ascending)]
    slope: Annotated[float, BeforeValidator(_SLOPE.parse)] | None = None
    offset: Number = 0.0
    share: tuple[Number, Number] | None = None
    absolute: bool = False
    ratiometric: bool = False
    reference: PositiveRaw
    reference_range: tuple[Raw, Raw] | None = None
    reference_channel: str | None = None
    low: Raw
    high: Raw
    noise: PositiveRaw
    error: PositiveNumber = 0.025
    bits: PositiveInteger
    full_scale: PositiveRaw
    gain_sigma: Annotated[Number, Ge(0)] = 0.01
    model_error: Annotated[Number, Ge(0)] = 0.05
    average: PositiveTime = 0.2
    hold_off: Duration = 1.0
    range_sigma: PositiveNumber = 5.0
    lag_frames: PositiveInteger = 10
    tare: TareSettings = TareSettings()
    leak: LeakSettings = LeakSettings()

    @model_validator(mode="before")
    @classmethod
    def _of_part(cls, data: Any) -> Any:
        return of_part(data, PRESSURE_PARTS)

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

    def filter(self, atmosphere_Pa: float) -> PressureSensor:
        """The filter of k channels at rest under an atmosphere [Pa]."""
        k, (slope, offset), (low, high) = len(self.channels), self.line, self.range
        span = self.error * (high - low)
        rest = atmosphere_Pa if self.absolute else 0.0
        # A good part that cannot read below its range may be off by its error there, at rest.
        lowest = low if self.absolute else low - span
        ends = self.reference_range if self.ratiometric and self.reference_range else (-np.inf, np.inf)
        return PressureSensor(
            gain_1_Pa=jnp.full(k, slope, float),
            offset=jnp.full(k, offset, float),
            rest_Pa=jnp.full(k, rest, float),
            low_Pa=jnp.full(k, lowest, float),
            high_Pa=jnp.full(k, high, float),
            lowest_gauge_Pa=jnp.full(k, low - rest, float),
            reference=jnp.asarray(self.reference, float),
            reference_low=jnp.asarray(ends[0], float),
            reference_high=jnp.asarray(ends[1], float),
            clip_low=jnp.asarray(self.low, float),
            clip_high=jnp.asarray(self.high, float),
            noise=jnp.asarray(self.noise, float),
            gain_sigma=jnp.asarray(self.gain_sigma, float),
            range_sigma=jnp.asarray(self.range_sigma, float),
            hold_off_s=jnp.asarray(self.hold_off, float),
            tare=self.tare.tare(span),
            leak=self.leak.test(),
            lag=self.lag_frames,
        )

    def _tapped(self, parts) -> list[ChamberPart]:
        chambers = parts.chambers_of(self.name, self.chambers)
        for name, chamber in zip(self.chambers, chambers, strict=True):
            if chamber.drive is None:
                raise self._wrong(f'chamber "{name}" is vented, so that there is no pressure in it')
        return chambers

    def sensor(self, parts):
        """Raises ConfigError for a chamber that there is not, or that is vented."""
        chambers, k = self._tapped(parts), len(self.channels)

        def each(values):
            return jnp.broadcast_to(jnp.array(values, float), (k,))

        return GaugePressure(
            self.name,
            self.columns,
            tuple(f"{self.name} {chamber}" for chamber in self.chambers),
            self.chambers,
            tuple(chamber.sealed for chamber in chambers),
            self.reference_channel is not None,
            self.filter(parts.atmosphere),
            each(self.gain),
            jnp.asarray(self.model_error, float),
            jnp.asarray(self.average, float),
            each([chamber.rest_volume + chamber.dead_volume for chamber in chambers]),
            each([chamber.atmosphere for chamber in chambers]),
            each([chamber.exponent for chamber in chambers]),
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
        k, (slope, _) = len(self.channels), self.line
        per_Pa, step = self.reference * slope, self.full_scale / 2**self.bits
        bound = _ZERO_BOUND * self.error * (self.range[1] - self.range[0]) * per_Pa
        one = np.arange(len(self.columns)) < k  # the reference is what it is
        return equal_channels(
            len(self.columns),
            gain=1.0 + one * rng.normal(0.0, _GAIN_SIGMA * self.gain_sigma, len(one)),
            zero=one * rng.uniform(-bound, bound, len(one)),
            slow_sigma=one * per_Pa * _DRIFT * self.tare.drift * _DRIFT_TIME_S,
            slow_time=_DRIFT_TIME_S,
            noise=self.noise,
            step=step,
            low=0.0,
            high=self.full_scale - step,
        )
