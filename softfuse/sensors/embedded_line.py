"""Lengths of a line in the material between stations: liquid-metal channels, stretch resistors, strain
fibres.

A channel of liquid metal keeps its volume, so its resistance is R = R₀ (L/L₀)² (Park, Majidi, Kramer, Bérard
and Wood, J. Micromech. Microeng. 20 (2010) 125029); a fibre or encoder tells the length itself.
"""

from dataclasses import replace
from typing import Annotated, Literal, Self

import jax.numpy as jnp
import numpy as np
from annotated_types import Ge
from jaxtyping import Array, Float
from pydantic import BeforeValidator, model_validator

from softfuse.functional.embedded_line import EmbeddedLine
from softfuse.io.quantity import Integer, LengthUnit, PositiveNumber, PositiveResistance
from softfuse.io.settings import NotEmpty, Vector, listed
from softfuse.mechanics.reading import ShapeReading
from softfuse.sensors.direct import AbstractConvert, Direct, DirectSettings, Scaled, ScaledSettings
from softfuse.sensors.parts import Parts


class LengthOfResistance(AbstractConvert):
    """L = L₀ √(R/R₀) of segments (k,), `rest` L₀ [m], `at_rest` R₀ [Ω]."""

    rest: Float[Array, " k"]
    at_rest: Float[Array, " k"]

    def __call__(self, raw):
        """Of resistances (k,) Ω; a negative one is none."""
        known = jnp.isfinite(raw) & (raw > 0)
        return jnp.where(known, self.rest * jnp.sqrt(jnp.where(known, raw, 1.0) / self.at_rest), jnp.nan)

    def since(self, value, zero):
        """As the resistance grows over that at rest, whatever that is."""
        return self.rest * (value / zero - 1.0)


class LineSettings(DirectSettings):
    """Along `path` (p, 3) m in the material, straight between its points; one channel for each segment.

    stations: numbers of the points between which it is read, in ascending order; without any, from end to
    end. noise: of a reading, offset_sigma: of the length at rest, drift: of that per second, all relative to
    the length.
    """

    path: Annotated[tuple[Vector, ...], NotEmpty]
    stations: tuple[Annotated[Integer, Ge(0)], ...] | None = None
    noise: PositiveNumber = 5e-4
    offset_sigma: PositiveNumber = 0.02
    drift: PositiveNumber = 1e-5

    def _line(self, parts: Parts) -> EmbeddedLine:
        line = EmbeddedLine.of(parts.body, np.array(self.path), stations=self.stations)
        if line.count != len(self.channels):
            raise self._wrong(f"{len(self.channels)} channels for {line.count} segments of the line")
        return line

    def lengths(self, parts: Parts) -> Float[np.ndarray, " k"]:
        """Of the segments at rest [m]."""
        rest = parts.body.rest
        return np.asarray(self._line(parts)(rest, jnp.zeros_like(rest)))

    def filter(self, parts: Parts, convert: AbstractConvert) -> Direct:
        """The filter of lengths [m] of the segments, which `convert` tells."""
        length = self.lengths(parts)
        return self._direct(self.segments(len(length)), convert, length, units=("m",), size=length)

    def segments(self, count: int) -> tuple[str, ...]:
        """Names of so many segments."""
        return ("",) if count == 1 else tuple(str(k) for k in range(count))

    def functional(self, parts):
        """Changes of the segments' lengths."""
        return ShapeReading(self._line(parts))


class LiquidMetalSettings(LineSettings):
    """A channel of liquid metal; `resistance`: of each segment at rest in Ω, or one of all; channels in Ω."""

    type: Literal["liquid-metal"] = "liquid-metal"
    resistance: Annotated[tuple[PositiveResistance, ...], NotEmpty, BeforeValidator(listed)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        self._one_each("resistance", self.resistance, len(self.channels))
        return self

    @property
    def _at_rest(self) -> Float[np.ndarray, " k"]:
        return np.broadcast_to(np.array(self.resistance), (len(self.channels),))

    def sensor(self, parts):
        """Raises MeshError for a line outside the body, ConfigError unless each segment has a channel."""
        length = self.lengths(parts)
        return self.filter(parts, LengthOfResistance(jnp.asarray(length), jnp.asarray(self._at_rest)))

    def ideal(self, parts, time_s, values):
        """Of changes of length (m, k) m."""
        del time_s
        return self._at_rest * (1.0 + np.asarray(values) / self.lengths(parts)) ** 2

    def electronics(self, parts, rng):
        """Channels that are wider or narrower than drawn, all along, and differ in gain."""
        del parts
        ohm = 2.0 * self._at_rest
        made = self._virtual(rng, ohm, self.drift, nothing=self._at_rest)
        return replace(made, gain=made.gain * (1.0 + made.zero / self._at_rest))


class LineLengthSettings(LineSettings, ScaledSettings):
    """What tells the length itself, or by how much a line is longer than at rest, in `unit`."""

    type: Literal["line-length"] = "line-length"
    unit: LengthUnit = 1e-3

    def _scaled(self, parts):
        """Raises MeshError for a line outside the body, ConfigError unless each segment has a channel."""
        length = self.lengths(parts)
        names = self.segments(len(length))
        return Scaled(names, ("m",), self.unit, length, size=length, about=length, drift=self.drift)
