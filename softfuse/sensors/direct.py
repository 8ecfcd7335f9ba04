"""Sensors whose raw readings are functions of what they measure, frame by frame: the filter that they share.

    value = mean over `average` of f(raw) − zero

f is the kind's own `convert`. The zero is taken and followed at rest (`tare`) where it is `tared`, else it is
what a perfect part says of the body at rest, which is then off by `offset_sigma` for good. The exponential
mean leaves σ √(dt / 2τ) of the noise and lags τ behind. What is missing is not valid, and leaves the mean
where it was.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.io.quantity import Duration, PositiveNumber
from softfuse.sensors.base import AbstractSensor, Measurement, SensorSettings
from softfuse.sensors.electronics import ChannelElectronics, equal_channels
from softfuse.sensors.parameters import parameters
from softfuse.sensors.tare import (
    Tare,
    TareState,
    TareTimes,
    tare_init,
    tare_known,
    tare_update,
    tare_variance,
)

if TYPE_CHECKING:
    from softfuse.sensors.parts import Parts

_GAIN_SIGMA = 0.5
"""Of virtual parts, in parts of what their settings allow."""


class AbstractConvert(eqx.Module):
    """From raw readings to what they mean in SI, and back."""

    @abstractmethod
    def __call__(self, raw: Float[Array, " n"]) -> Float[Array, " k"]:
        """Values (k,) of raw readings (n,); NaN where something is missing."""

    def since(self, value: Float[Array, " k"], zero: Float[Array, " k"]) -> Float[Array, " k"]:
        """Changes (k,) of values (k,) from those at rest, `zero` (k,)."""
        return value - zero

    def beside_zero(self, change: Float[Array, " k"], offset_sigma: Float[Array, " k"]) -> Float[Array, " k"]:
        """Standard deviations (k,) of changes (k,) from a zero, which may be wrong by `offset_sigma` (k,),
        where taking it off is not all that there is to it; 0 where it is.
        """
        del offset_sigma
        return jnp.zeros_like(change)


class Scale(AbstractConvert):
    """Values are raw readings times a factor (k,), or one for all."""

    factor: Float[Array, "*k"]

    def __call__(self, raw):
        """The product."""
        return self.factor * raw


class DirectState(eqx.Module):
    """Memory between frames: zeros, and means (k,), known or not."""

    tare: TareState
    mean: Float[Array, " k"]
    known: Bool[Array, " k"]


class Direct(AbstractSensor):
    """k readings of n channels.

    `rest` (k,): values of a perfect part at rest; `noise`, `offset_sigma` (k,): standard deviations of a
    value, and of its zero where it is not tared; `gain_sigma` [-]: of the gain; `driven_above` (k,): changes
    that only a driven actuator makes, ∞ where none does.
    """

    tared: bool = eqx.field(static=True)
    convert: AbstractConvert
    rest: Float[Array, " k"]
    noise: Float[Array, " k"]
    offset_sigma: Float[Array, " k"]
    gain_sigma: Float[Array, ""]
    average_s: Float[Array, ""]
    tare: Tare
    driven_above: Float[Array, " k"]

    def init(self):
        """At rest."""
        return DirectState(
            tare_init(self.tare, self.rest), jnp.zeros_like(self.rest), jnp.zeros(self.rest.shape, bool)
        )

    def driven(self, state, raw):
        """Whether a value has changed by more than the body can make it."""
        change = self.convert.since(self.convert(raw), state.tare.zero_Pa)
        return jnp.any(jnp.where(jnp.isfinite(change), jnp.abs(change) > self.driven_above, False))

    def update(self, state, frame, raw, context):
        """Raw readings (n,); `details`: the values (k,) of this frame."""
        value = self.convert(raw)
        read = jnp.isfinite(value)
        tare = state.tare
        if self.tared:
            at_rest = read & context.resting
            finite = jnp.where(read, value, tare.zero_Pa)
            tare = tare_update(self.tare, tare, frame.dt_s, finite, self.noise, at_rest)
        change = self.convert.since(value, tare.zero_Pa)
        share = jnp.where(
            self.average_s > 0, 1 - jnp.exp(-frame.dt_s / jnp.maximum(self.average_s, 1e-9)), 1.0
        )
        fresh = jnp.where(state.known, state.mean + share * (change - state.mean), change)
        mean = jnp.where(read, fresh, state.mean)
        variance = tare_variance(self.tare, tare) if self.tared else self.offset_sigma**2
        left = self.noise**2 * share / (2 - share)
        beside = self.convert.beside_zero(mean, self.offset_sigma)
        sigma = jnp.sqrt(left + variance + (self.gain_sigma * mean) ** 2 + beside**2)
        valid = read & (tare_known(self.tare, tare) | jnp.asarray(not self.tared))
        flags = {f"{self.name} missing": jnp.any(~read)}
        return DirectState(tare, mean, state.known | read), Measurement(
            mean, sigma, valid, flags, details=value
        )


class DirectSettings(TareTimes, SensorSettings):
    """What such sensors have in common; kinds give the size of their zero's and noise's errors.

    tared: whether the zero is taken at rest, else what a perfect part says of the model at rest is the zero.
    gain_sigma: relative error of a part; average in s.
    """

    tared: bool = True
    gain_sigma: PositiveNumber = 0.01
    average: Duration = 0.1

    if TYPE_CHECKING:  # fields of each kind, with its own units and defaults
        noise: float
        offset_sigma: float
        drift: float

    @property
    def _errors(self) -> tuple[Any, Any, Any]:
        """Standard deviations (k,), or one for all, of a value, of its zero, and of the zero's drift per
        second.
        """
        return self.noise, self.offset_sigma, self.drift

    def _direct(
        self,
        readings: tuple[str, ...],
        convert: AbstractConvert,
        rest: Any,
        *,
        units: Sequence[str],
        size: Any = 1.0,
        driven_above: Any = np.inf,
    ) -> Direct:
        """The filter of values that are `rest` (k,) at rest, in SI units (k,) or one for all; size (k,): that
        in which errors are told [SI].
        """
        k = len(readings)

        def each(value) -> Array:
            return jnp.broadcast_to(jnp.asarray(value, float), (k,))

        noise, offset_sigma, drift = (each(error * size) for error in self._errors)
        return parameters(
            Direct,
            self,
            channels=self.columns,
            readings=tuple(f"{self.name} {which}" if which else self.name for which in readings),
            units=tuple(units) * (1 if len(units) == k else k),
            chambers=(),
            convert=convert,
            rest=each(rest),
            noise=noise,
            offset_sigma=offset_sigma,
            tare=parameters(Tare, self, offset_sigma_Pa=offset_sigma, drift_Pa_s=drift),
            driven_above=each(driven_above),
        )

    def _virtual(
        self, rng: np.random.Generator, per: Any, drift: Any, *, nothing: Any = 0.0
    ) -> ChannelElectronics:
        """Parts that differ in gain, about `nothing` (n,), and in zero, which drifts per second; `per` (n,):
        raw readings in one of what errors are told in.
        """
        (noise, offset_sigma, _), count = self._errors, len(self.channels)
        return equal_channels(
            count,
            nothing=nothing,
            gain=self._gains(rng, count),
            zero=rng.normal(0.0, offset_sigma, count) * per,
            drift=drift * per,
            noise=noise * per,
        )

    def _gains(self, rng: np.random.Generator, count: int) -> Float[np.ndarray, " k"]:
        """Gains of so many virtual parts."""
        return 1.0 + rng.normal(0.0, _GAIN_SIGMA * self.gain_sigma, count)


class Scaled(NamedTuple):
    """Values that are raw readings times `factor` (k,), or one for all.

    names, units, rest, size, driven_above: see `DirectSettings._direct`. Of virtual parts: values (k,)
    `about` which gains are off, and the `drift` of zeros per second, in `size`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    factor: Any
    rest: Any = 0.0
    size: Any = 1.0
    driven_above: Any = np.inf
    about: Any = 0.0
    drift: float = 0.0


class ScaledSettings(DirectSettings):
    """Sensors whose values are raw readings times a factor."""

    @abstractmethod
    def _scaled(self, parts: "Parts") -> Scaled:
        """What they tell; raises what `sensor` does."""

    def sensor(self, parts):
        """Raises ConfigError, or MeshError, for what there is not, or where the body is not."""
        told = self._scaled(parts)
        return self._direct(
            told.names,
            Scale(jnp.asarray(told.factor, float)),
            told.rest,
            units=told.units,
            size=told.size,
            driven_above=told.driven_above,
        )

    def ideal(self, parts, time_s, values):
        """Of changes (m, k) of the values."""
        del time_s
        told = self._scaled(parts)
        return (told.rest + np.asarray(values)) / told.factor

    def electronics(self, parts, rng):
        """Parts that are off at rest and in gain."""
        told = self._scaled(parts)
        per = told.size / np.abs(told.factor)
        return self._virtual(rng, per, told.drift, nothing=told.about / told.factor)
