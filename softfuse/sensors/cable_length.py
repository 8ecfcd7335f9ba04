"""By how much cables have been shortened: encoders of winches, or rulers.

Lengths are averaged over `average`, as pressures are, so that both tell the same shape; a cable shorter than
its `slack` drives the body.
"""

from typing import Annotated, Literal, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from pydantic import BeforeValidator, model_validator

from softfuse.io.quantity import Length, LengthUnit, PositiveLength, PositiveTime
from softfuse.io.settings import NotEmpty, listed
from softfuse.mechanics.reading import AnswerReading
from softfuse.sensors.base import AbstractSensor, Measurement, Names, SensorSettings
from softfuse.sensors.electronics import equal_channels
from softfuse.sensors.parameters import parameters

_STEP = 1e-6
"""Step in which virtual lengths are told [m]."""


class CableLength(AbstractSensor):
    """Lengths of b cables, in `unit` [m]; `zero_m` (b,): read where they get taut."""

    unit_m: Float[Array, ""]
    zero_m: Float[Array, " b"]
    noise_m: Float[Array, ""]
    slack_m: Float[Array, ""]
    average_s: Float[Array, ""]

    def _shortening(self, raw: Float[Array, " b"]) -> Float[Array, " b"]:
        return raw * self.unit_m - self.zero_m

    def init(self):
        """Nothing has been read: mean lengths (b,) [m]."""
        return jnp.full(len(self.channels), jnp.nan, float)

    def driven(self, state, raw):
        """Whether a cable is pulled beyond its slack."""
        # A length that is not read says nothing: a cable that slips off must not stop the tare for ever.
        length = self._shortening(raw)
        return jnp.any(jnp.where(jnp.isfinite(length), jnp.abs(length) > self.slack_m, False))

    def update(self, state, frame, raw, context):
        """Lengths (b,) in their unit; `details`: the shortenings (b,) [m] of this frame."""
        length = self._shortening(raw)
        lag = jnp.exp(-frame.dt_s / self.average_s)
        mean = jnp.where(jnp.isfinite(state), length + lag * (state - length), length)
        known = jnp.isfinite(mean)
        flags = {f"{self.name} missing": jnp.any(~jnp.isfinite(raw))}
        sigma = jnp.full(len(self.channels), self.noise_m)
        return mean, Measurement(jnp.where(known, mean, 0.0), sigma, known, flags, details=length)


class CableLengthSettings(SensorSettings):
    """By how much each cable has been shortened; a frame without a reading has an empty field.

    channels: one column per cable, in `unit`; zero in m: what is read where the cable gets taut, one value or
    one for each cable; noise: standard deviation in m; slack in m: a cable that is shorter by less leaves the
    body at rest; average in s.
    """

    type: Literal["cable-length"] = "cable-length"
    cables: Names
    unit: LengthUnit = 1e-3
    zero: Annotated[tuple[Length, ...], NotEmpty, BeforeValidator(listed)] = (0.0,)
    noise: PositiveLength = 0.05e-3
    slack: PositiveLength = 0.5e-3
    average: PositiveTime = 0.2

    @model_validator(mode="after")
    def _check(self) -> Self:
        self._one_each("zero", self.zero, len(self.channels))
        self._one_each("channels", self.channels, len(self.cables))
        return self

    @property
    def quantities(self):
        """One of each cable."""
        return ("shortening",) * len(self.cables)

    def sensor(self, parts):
        """Raises ConfigError for a cable that there is not."""
        parts.cables_of(self.name, self.cables)
        return parameters(
            CableLength,
            self,
            readings=tuple(f"{self.name} {cable}" for cable in self.cables),
            units=("m",) * len(self.cables),
            chambers=(),
            zero_m=jnp.broadcast_to(jnp.array(self.zero, float), (len(self.channels),)),
        )

    def functional(self, parts):
        """What answers the tensions."""
        return AnswerReading(tuple(cable.drive for cable in parts.cables_of(self.name, self.cables)))

    @property
    def slacks(self):
        """The same of all."""
        return dict.fromkeys(self.cables, self.slack)

    def zeros_after(self, shift):
        """As configured, and so much more."""
        zero = np.broadcast_to(self.zero, (len(self.cables),))
        return zero + [shift.get(name, 0.0) for name in self.cables]

    def ideal(self, parts, time_s, values):
        """Of shortenings (m, b) m."""
        del parts, time_s
        return (np.asarray(values) + np.array(self.zero)) / self.unit

    def electronics(self, parts, rng):
        """White noise, in steps."""
        del parts, rng
        return equal_channels(len(self.channels), noise=self.noise / self.unit, step=_STEP / self.unit)
