"""Flow sensors on the vents of chambers: the volume that has been squeezed out.

Parts (data sheets): OMRON D6F-P0001A1: 0.5 V at zero flow, 20 V per L/min, linear up to 2.5 V, and flow into
the chamber reads below and clips at 0 V. Sensirion SFM3000: 16 bits, (counts − 32000) / 140 standard litres
of air per minute, up to ±200. Noise, zero and their drift of the former are those of recordings; of the
latter they follow from the sheet's 0.05 L/min of noise.
"""

from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from annotated_types import Gt
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
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.flow.filter import (
    FlowSensor,
    flow_drift,
    flow_init,
    flow_unknown,
    flow_update,
    mean_flow,
)
from softfuse.sensors.transfer import PartSettings, PositiveRaw, Raw, RawSpread, RawWalk, in_output, of_part
from softfuse.sensors.zero_drift import ZeroDrift

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


class Flow(AbstractSensor):
    """Flow sensors with one filter of their zeros, one on each of some chambers."""

    name: str = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    readings: tuple[str, ...] = eqx.field(static=True)
    vented: tuple[str, ...] = eqx.field(static=True)
    filter: FlowSensor

    @property
    def chambers(self):
        """Those that are vented through it."""
        return self.vented

    @property
    def drift(self):
        """That of the zeros."""
        return flow_drift(self.filter)

    @property
    def units(self):
        """Volumes."""
        return ("m^3",) * len(self.readings)

    def init(self):
        """Untouched."""
        return flow_init(self.filter)

    def hint(self, state):
        """The flow; within the hold-off after a touch it is air that flows back."""
        flow = mean_flow(self.filter, state)
        calm = jnp.broadcast_to(state.released_s > self.filter.hold_off_s, flow.shape)
        return Hint(flow, calm, jnp.zeros(flow.shape, bool))

    def update(self, state, frame, raw, context):
        """Readings [V] or [counts] to volume changes; `details`: the FlowReading."""
        # What was squeezed out before the first frame is not known.
        unknown = flow_unknown(self.filter, state)
        state = jax.tree.map(lambda a, b: jnp.where(context.begun_touched, a, b), unknown, state)
        moved = context.touching | context.driven
        state, seen = flow_update(self.filter, state, frame.dt_s, raw, moved)
        flags = {
            f"{self.name} missing": jnp.any(seen.missing),
            f"{self.name} saturated": jnp.any(seen.saturated),
        }
        change, valid = seen.volume_change_m3, seen.volume_valid
        told = VolumeChange(change, valid)
        return state, Measurement(change, seen.volume_sigma_m3, valid, flags, seen.drift, told, seen)


class FlowSettings(PartSettings):
    """Flow sensors on vented chambers, one channel for each; keys left out are those of the `part`.

    output: what channels carry, "volts" or "counts"; zero, low, high, noise, bias_sigma, wander_sigma,
    lost_sigma, full_scale in its unit, sensitivity per flow, bias_walk per √s, times in s: see `flow.filter`.
    gain [-]: what is measured over what flows, one value or one for each chamber. bits, full_scale: of the
    converter. noise, wander_sigma and wander_time are read off the structure function (half the mean square
    difference over a lag) of a few minutes of readings at rest: its value at short lags, its rise and the lag
    at which it has risen by 63 %.
    """

    quantity: ClassVar[str] = "volume"

    type: Literal["flow"] = "flow"
    part: str | None = None
    output: Literal["volts", "counts"] = "volts"
    zero: Raw
    sensitivity: Annotated[float, in_output(FLOW_SENSITIVITY, _COUNTS_PER_FLOW), Gt(0)]
    low: Raw
    high: Raw
    noise: PositiveRaw
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
    bits: PositiveInteger
    full_scale: PositiveRaw

    @model_validator(mode="before")
    @classmethod
    def _of_part(cls, data: Any) -> Any:
        return of_part(data, _PARTS)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.low < self.zero < self.high:
            raise wrong_value(
                f"zero = {self.zero:g} must lie between low = {self.low:g} and high = {self.high:g}"
            )
        return self

    def filter(self) -> FlowSensor:
        """The filter of k channels."""
        count = len(self.channels)
        return FlowSensor(
            zero_V=jnp.full(count, self.zero, float),
            sensitivity_Vs_m3=self.sensitivity * jnp.broadcast_to(jnp.array(self.gain, float), (count,)),
            low_V=jnp.asarray(self.low, float),
            high_V=jnp.asarray(self.high, float),
            drift=ZeroDrift(
                noise_V=jnp.asarray(self.noise, float),
                bias_sigma_V=jnp.asarray(self.bias_sigma, float),
                bias_walk_V=jnp.asarray(self.bias_walk, float),
                wander_sigma_V=jnp.asarray(self.wander_sigma, float),
                wander_time_s=jnp.asarray(self.wander_time, float),
            ),
            hold_off_s=jnp.asarray(self.hold_off, float),
            gate_sigma=jnp.asarray(self.gate_sigma, float),
            relearn_s=jnp.asarray(self.relearn, float),
            longest_gap_s=jnp.asarray(self.longest_gap, float),
            lost_sigma_V=jnp.asarray(self.lost_sigma, float),
            lost_tolerance_s=jnp.asarray(self.lost_tolerance, float),
            lag=self.lag_frames,
        )

    def sensor(self, parts):
        """Raises ConfigError for a chamber that there is not, or that has no vent."""
        for name, chamber in zip(self.chambers, parts.chambers_of(self.name, self.chambers), strict=True):
            if chamber.drive is not None:
                raise self._wrong(f'chamber "{name}" has no vent through which gas could flow')
        readings = tuple(f"{self.name} {chamber}" for chamber in self.chambers)
        return Flow(self.name, self.channels, readings, self.chambers, self.filter())

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
        count, step = len(self.channels), self.full_scale / 2**self.bits
        return equal_channels(
            count,
            nothing=self.zero,
            gain=1.0 + rng.uniform(-_GAIN_BOUND, _GAIN_BOUND, count),
            zero=self.bias_sigma * rng.uniform(-_ZERO_BOUND, _ZERO_BOUND, count),
            wander_sigma=self.wander_sigma,
            wander_time=self.wander_time,
            slow_sigma=_SLOW_SIGMA * self.bias_sigma,
            slow_time=_SLOW_TIME_S,
            noise=self.noise,
            step=step,
            low=0.0,
            high=self.full_scale - step,
        )
