"""Thermal flow sensors on the vents of chambers: volts to the volume that has been squeezed out.

    Q = (V - V0) / S,   dPhi = -integral of Q dt,

Q [m^3/s] is positive out of the chamber, so a chamber that is squeezed has a negative volume change. S is the
sensitivity [V s/m^3]. V stands for the unit of the channel, counts where it is digital.

The zero V0 wanders, and an error of 1 mV integrates to 8.3 mm^3 in 10 s. It is tracked by a Kalman filter
(`zero_drift`) while nothing touches and only predicted while something does. Tracking must not eat real flow:
* the filter runs `lag` frames behind the readings, and when a touch is seen, the frames of the lag are
  integrated, not tracked: flow that began before the touch was recognised is not lost;
* after a release, air flows back: the zero is tracked again, and the integral reset, when nothing has touched
  and the mean over the lag has agreed with the predicted zero within `gate_sigma` standard deviations
  for `hold_off_s`;
* a zero that has truly jumped would never pass that gate: after `relearn_s` without touch the filter is
  reset.

Parts (data sheets): OMRON D6F-P0001A1: 0.5 V at zero flow, 20 V per L/min, linear up to 2.5 V, and flow into
the chamber reads below and clips at 0 V. Sensirion SFM3000: 16 bits, (counts − 32000) / 140 standard litres
of air per minute, up to ±200. Noise, zero and their drift of the former are those of recordings; of the
latter they follow from the sheet's 0.05 L/min of noise.
"""

from dataclasses import replace
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from annotated_types import Gt
from jaxtyping import Array, Bool, Float
from pydantic import model_validator

from softfuse.io.quantity import (
    FLOW_SENSITIVITY,
    Dimension,
    Duration,
    PositiveInteger,
    PositiveNumber,
    PositiveTime,
    wrong_value,
)
from softfuse.mechanics.reading import JointReading, ShapeReading
from softfuse.sensors.base import AbstractSensor, Hint, Measurement, VolumeChange
from softfuse.sensors.lag import lag_of, oldest, pushed, usable_mean
from softfuse.sensors.parameters import parameters
from softfuse.sensors.transfer import PartSettings, PositiveRaw, Raw, RawSpread, RawWalk, in_output
from softfuse.sensors.zero_drift import (
    DriftModel,
    ReadingDrift,
    ZeroDrift,
    ZeroEstimate,
    observe_zero,
    predict_zero,
    restart_integral,
    zero_prior,
    zero_variance,
)

_COUNTS_PER_FLOW = Dimension("counts per flow", "s/m^3", "140 min/L")

_PARTS = MappingProxyType(
    {
        "D6F-P0001A1": {
            "output": "volts",
            "zero": "0.5 V",
            "sensitivity": "20 V min/L",
            "low": "2 mV",
            "high": "2.5 V",
            "noise": "2 mV",
            "bias_sigma": "10 mV",
            "bias_walk": "0.02 mV/s^0.5",
            "wander_sigma": "0.4 mV",
            "lost_sigma": "0.5 V",
            "bits": 12,
            "full_scale": "3.3 V",
        },
        "SFM3000": {
            "output": "counts",
            "zero": 32000.0,
            "sensitivity": "140 min/L",
            "low": 4000.0,
            "high": 60000.0,
            "noise": 7.0,
            "bias_sigma": 7.0,
            "bias_walk": 0.05,
            "wander_sigma": 1.0,
            "lost_sigma": 3500.0,
            "bits": 16,
            "full_scale": 65536.0,
        },
    }
)

# Of virtual parts: bounds of zeros and of a slow wander in parts of `bias_sigma`, time of that wander, bound
# of gains.
_ZERO_BOUND, _SLOW_SIGMA, _SLOW_TIME_S, _GAIN_BOUND = 0.6, 0.08, 1800.0, 0.01


class FlowFrame(NamedTuple):
    """What k channels said in a frame, or in each of n: the step to it [s], readings [V], their integral over
    it [V s], the part of it [s] in which the flow is not known, whether a reading says the flow, and whether
    it is clipped.
    """

    dt_s: Float[Array, "*n"]
    reading_V: Float[Array, "*n k"]
    area_Vs: Float[Array, "*n k"]
    lost_s: Float[Array, "*n k"]
    usable: Bool[Array, "*n k"]
    saturated: Bool[Array, "*n k"]


class FlowState(eqx.Module):
    """Memory between frames: the zero and the integral `lag` frames ago and the frames since."""

    zero: ZeroEstimate
    integral_Vs: Float[Array, " k"]
    lost_s: Float[Array, " k"]
    saturated: Bool[Array, " k"]
    released_s: Float[Array, ""]
    calm_s: Float[Array, " k"]
    unquiet_s: Float[Array, " k"]
    last_V: Float[Array, " k"]
    seen: Bool[Array, " k"]
    pending_s: Float[Array, " k"]
    lag: FlowFrame
    """Each (n, ...)."""


class FlowReading(eqx.Module):
    """What the sensors say about one frame."""

    flow_m3_s: Float[Array, " k"]
    """(k,) flow out of the chambers [m^3/s]."""
    volume_change_m3: Float[Array, " k"]
    """(k,) volume change since the reset [m^3]."""
    volume_sigma_m3: Float[Array, " k"]
    """(k,) its standard deviation: noise, error and wander of the zero, lost flow [m^3]."""
    volume_valid: Bool[Array, " k"]
    """(k,) no more than the tolerated time of flow was lost since the reset."""
    saturated: Bool[Array, " k"]
    """(k,) the channel was clipped at some time since the reset."""
    missing: Bool[Array, " k"]
    """(k,) no reading in this frame."""
    zero_V: Float[Array, " k"]
    """(k,) predicted zero now [V]."""
    drift: ReadingDrift
    """What the volume change is off by, if no flow was lost."""


class Flow(AbstractSensor):
    """k equal flow sensors, one on each of some chambers."""

    zero_V: Float[Array, " k"]
    """(k,) nominal zero [V]."""
    sensitivity_Vs_m3: Float[Array, " k"]
    """(k,) sensitivity S [V s/m^3]."""
    low_V: Float[Array, ""]
    """Readings at or below are clipped [V]."""
    high_V: Float[Array, ""]
    """Readings at or above are clipped or beyond the linear range [V]."""
    zero_drift: ZeroDrift
    """Noise model of the zero."""
    hold_off_s: Float[Array, ""]
    """Time after touch or flow in which the zero is not tracked [s]; at least that of `lag` frames."""
    gate_sigma: Float[Array, ""]
    """Largest deviation of the lag's mean from the predicted zero that is quiet [standard deviations]."""
    relearn_s: Float[Array, ""]
    """Time without touch and without quiet after which the zero is learnt anew [s]."""
    longest_gap_s: Float[Array, ""]
    """Longest time between two readings that is bridged by the trapezoidal rule [s]."""
    lost_sigma_V: Float[Array, ""]
    """Standard deviation of the unknown flow while a channel is clipped or missing [V]."""
    lost_tolerance_s: Float[Array, ""]
    """Time of unknown flow since the reset up to which a volume is still called valid [s]."""
    lag_frames: int = eqx.field(static=True)
    """Number of frames by which the zero filter runs behind."""

    @property
    def drift(self):
        """That of the zeros: a volt second too much is so much volume too little."""
        zero = jax.tree.map(lambda value: jnp.broadcast_to(value, self.zero_V.shape), self.zero_drift)
        return DriftModel(zero, -1.0 / self.sensitivity_Vs_m3)

    def init(self):
        """Untouched."""
        # A state of other dtypes than its successor's would compile the update twice.
        nominal = jnp.asarray(self.zero_V, float)
        nothing, no = jnp.zeros(nominal.shape), jnp.zeros(nominal.shape, bool)
        return FlowState(
            zero=zero_prior(self.zero_drift, nominal),
            integral_Vs=nothing,
            lost_s=nothing,
            saturated=no,
            released_s=jnp.asarray(self.hold_off_s, float),
            calm_s=jnp.full(nominal.shape, self.hold_off_s, float),
            unquiet_s=nothing,
            last_V=nominal,
            seen=no,
            pending_s=nothing,
            lag=lag_of(FlowFrame(jnp.zeros(()), nominal, nothing, nothing, no, no), self.lag_frames),
        )

    def hint(self, state):
        """The flow; within the hold-off after a touch it is air that flows back."""
        variance = zero_variance(state.zero) + self.zero_drift.noise_V**2 / self.lag_frames
        mean = jnp.mean(state.lag.reading_V, axis=0) - state.zero.bias_V - state.zero.wander_V
        flow = mean / jnp.sqrt(variance)
        calm = jnp.broadcast_to(state.released_s > self.hold_off_s, flow.shape)
        return Hint(flow, calm, jnp.zeros(flow.shape, bool))

    def update(self, state, frame, raw, context):
        """Readings [V] or [counts] to volume changes; `details`: the FlowReading."""
        # What was squeezed out before the first frame is not known until the next reset.
        lost = self.lost_tolerance_s + self.relearn_s
        state = replace(state, lost_s=jnp.where(context.begun_touched, lost, state.lost_s))
        state, seen = self.filtered(state, frame.dt_s, raw, context.touching | context.driven)
        flags = {
            f"{self.name} missing": jnp.any(seen.missing),
            f"{self.name} saturated": jnp.any(seen.saturated),
        }
        change, valid = seen.volume_change_m3, seen.volume_valid
        told = VolumeChange(change, valid)
        return state, Measurement(change, seen.volume_sigma_m3, valid, flags, seen.drift, told, seen)

    def filtered(
        self,
        state: FlowState,
        dt_s: Float[Array, ""],
        flow_V: Float[Array, " k"],
        touching: Bool[Array, ""],
    ) -> tuple[FlowState, FlowReading]:
        """One frame.

        Args: dt_s time since the last frame [s], 0 for the first; flow_V (k,) readings [V], NaN where
        missing; touching: whether something touches the body, or drives it, in this frame.
        """
        state = self._push(self._advance(state, dt_s, touching), dt_s, flow_V)
        lag = state.lag
        frames = jnp.sum(lag.dt_s > 0)
        ahead, zero_area = predict_zero(self.zero_drift, state.zero, jnp.sum(lag.dt_s), frames)
        integral = state.integral_Vs + jnp.sum(lag.area_Vs, axis=0) - zero_area
        lost = state.lost_s + jnp.sum(lag.lost_s, axis=0) + state.pending_s
        missing = ~jnp.isfinite(flow_V)
        sigma = jnp.sqrt(ahead.covariance[:, 2, 2] + (self.lost_sigma_V * lost) ** 2)
        zero = ahead.bias_V + ahead.wander_V
        return state, FlowReading(
            flow_m3_s=(state.last_V - zero) / self.sensitivity_Vs_m3,
            volume_change_m3=-integral / self.sensitivity_Vs_m3,
            volume_sigma_m3=sigma / self.sensitivity_Vs_m3,
            volume_valid=state.seen & ~missing & (lost <= self.lost_tolerance_s),
            saturated=state.saturated | jnp.any(lag.saturated, axis=0),
            missing=missing,
            zero_V=zero,
            drift=ReadingDrift(ahead.covariance, state.calm_s > 0.0, jnp.asarray(dt_s, float)),
        )

    def _push(self, state: FlowState, dt_s: Float[Array, ""], flow_V: Float[Array, " k"]) -> FlowState:
        """Append a frame to the lag and drop the oldest, which the caller has taken."""
        present = jnp.isfinite(flow_V)
        reading = jnp.where(present, flow_V, state.last_V)
        clipped = present & ((reading <= self.low_V) | (reading >= self.high_V))
        known = present & state.seen
        # Trapezoid from the channel's last reading; a missing one is held until the next tells the slope.
        held = jnp.where(state.seen, state.last_V, reading)
        area = 0.5 * (held + reading) * dt_s + jnp.where(known, 0.5 * (reading - held) * state.pending_s, 0.0)
        interval = state.pending_s + dt_s
        lost = jnp.where(clipped, dt_s, 0.0)
        lost = jnp.where(known & (interval > self.longest_gap_s), interval, lost)
        lost = jnp.where(present & ~state.seen, interval, lost)
        return replace(
            state,
            last_V=reading,
            seen=state.seen | present,
            pending_s=jnp.where(present, 0.0, interval),
            lag=pushed(state.lag, FlowFrame(dt_s, reading, area, lost, present & ~clipped, clipped)),
        )

    def _advance(self, state: FlowState, dt_s: Float[Array, ""], touching: Bool[Array, ""]) -> FlowState:
        """Move zero and integral over the oldest frame of the lag: track or integrate."""
        model, zero, old = self.zero_drift, state.zero, oldest(state.lag)
        mean, count = usable_mean(state.lag.reading_V, state.lag.usable)
        spread = jnp.sqrt(zero_variance(zero) + model.noise_V**2 / jnp.maximum(count, 1))
        deviation = jnp.where(count > 0, (mean - zero.bias_V - zero.wander_V) / spread, 0.0)
        flowing = jnp.abs(deviation) >= self.gate_sigma
        calm = jnp.where(touching | flowing, 0.0, state.calm_s + dt_s)
        quiet = (calm > self.hold_off_s) & (2 * count >= self.lag_frames)
        unquiet = jnp.where(~touching & flowing, state.unquiet_s + dt_s, 0.0)
        relearn = unquiet > self.relearn_s
        prior = zero_prior(model, self.zero_V)
        zero = ZeroEstimate(
            bias_V=jnp.where(relearn, prior.bias_V, zero.bias_V),
            wander_V=jnp.where(relearn, prior.wander_V, zero.wander_V),
            covariance=jnp.where(relearn[:, None, None], prior.covariance, zero.covariance),
        )
        zero, zero_area = predict_zero(model, zero, old.dt_s, jnp.ones(()))
        spread = jnp.sqrt(zero_variance(zero) + model.noise_V**2)
        likely = jnp.abs(old.reading_V - zero.bias_V - zero.wander_V) < self.gate_sigma * spread
        zero = observe_zero(model, zero, old.reading_V, quiet & likely & old.usable & (old.dt_s > 0))
        return replace(
            state,
            zero=restart_integral(zero, quiet),
            integral_Vs=jnp.where(quiet, 0.0, state.integral_Vs + old.area_Vs - zero_area),
            lost_s=jnp.where(quiet, 0.0, state.lost_s + old.lost_s),
            saturated=~quiet & (state.saturated | old.saturated),
            released_s=jnp.where(touching, 0.0, state.released_s + dt_s),
            calm_s=calm,
            unquiet_s=unquiet,
        )


class FlowSettings(PartSettings):
    """Flow sensors on vented chambers.

    zero, bias_sigma, wander_sigma, lost_sigma in the unit of the channels, sensitivity per flow, bias_walk
    per √s, times in s: see `Flow`. noise, wander_sigma and wander_time are read off the structure function
    (half the mean square difference over a lag) of a few minutes of readings at rest: its value at short
    lags, its rise and the lag at which it has risen by 63 %.
    """

    known_parts: ClassVar = _PARTS
    quantity: ClassVar = "volume"

    type: Literal["flow"] = "flow"
    zero: Raw
    sensitivity: Annotated[float, in_output(FLOW_SENSITIVITY, _COUNTS_PER_FLOW), Gt(0)]
    bias_sigma: PositiveRaw
    bias_walk: RawWalk
    wander_sigma: RawSpread
    wander_time: PositiveTime = 3.0
    hold_off: Duration = 0.5
    gate_sigma: PositiveNumber = 4.0
    relearn: PositiveTime = 5.0
    longest_gap: PositiveTime = 0.1
    lost_sigma: PositiveRaw
    lost_tolerance: Duration = 0.0
    lag_frames: PositiveInteger = 20

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.low < self.zero < self.high:
            raise wrong_value(
                f"zero = {self.zero:g} must lie between low = {self.low:g} and high = {self.high:g}"
            )
        return self

    def sensor(self, parts):
        """Raises ConfigError for a chamber that there is not, or that has no vent."""
        for name, chamber in zip(self.chambers, parts.chambers_of(self.name, self.chambers), strict=True):
            if chamber.drive is not None:
                raise self._wrong(f'chamber "{name}" has no vent through which gas could flow')
        count = len(self.channels)
        return parameters(
            Flow,
            self,
            readings=self.readings,
            units=("m^3",) * count,
            zero_V=jnp.full(count, self.zero, float),
            sensitivity_Vs_m3=self.sensitivity * jnp.broadcast_to(jnp.array(self.gain, float), (count,)),
            zero_drift=parameters(ZeroDrift, self),
        )

    def functional(self, parts):
        """The changes of the chambers' volumes."""
        chambers = parts.chambers_of(self.name, self.chambers)
        return JointReading(tuple(ShapeReading(chamber.cavity) for chamber in chambers))

    def ideal(self, parts, time_s, values):
        """Of changes of volume (m, k) m³: Q = −dV/dt."""
        del parts
        return self.zero - self.sensitivity * np.gradient(np.asarray(values), time_s, axis=0)

    def electronics(self, parts, rng):
        """Parts that differ in zero and gain, on the converter."""
        del parts
        count = len(self.channels)
        return self._converted(
            nothing=self.zero,
            gain=1.0 + rng.uniform(-_GAIN_BOUND, _GAIN_BOUND, count),
            zero=self.bias_sigma * rng.uniform(-_ZERO_BOUND, _ZERO_BOUND, count),
            wander_sigma=self.wander_sigma,
            wander_time=self.wander_time,
            slow_sigma=_SLOW_SIGMA * self.bias_sigma,
            slow_time=_SLOW_TIME_S,
        )
