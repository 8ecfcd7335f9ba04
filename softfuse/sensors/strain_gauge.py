"""A resistive strain gauge along a line in the material: ΔR/R₀ = k (L/L₀ − 1) with its gauge factor k."""

from typing import Literal

import jax.numpy as jnp
import numpy as np

from softfuse.io.quantity import PositiveNumber
from softfuse.sensors.direct import AbstractConvert
from softfuse.sensors.embedded_line import LineSettings


class GaugeLength(AbstractConvert):
    """L = L₀ (1 + (ΔR/R₀)/k) of segments (k,)."""

    rest: jnp.ndarray
    factor: jnp.ndarray

    def __call__(self, raw):
        """Of ΔR/R₀ (k,)."""
        return self.rest * (1.0 + raw / self.factor)


class StrainGaugeSettings(LineSettings):
    """A gauge of a `factor` along a line; channels: ΔR/R₀, as a bridge tells it."""

    type: Literal["strain-gauge"] = "strain-gauge"
    factor: PositiveNumber = 2.0

    def sensor(self, parts):
        """Raises MeshError for a line outside the body, ConfigError unless each segment has a channel."""
        length = jnp.asarray(self.lengths(parts))
        return self.filter(parts, GaugeLength(length, jnp.asarray(self.factor, float)))

    def ideal(self, parts, time_s, values):
        """Of changes of length (m, k) m."""
        del time_s
        return self.factor * np.asarray(values) / self.lengths(parts)

    def electronics(self, parts, rng):
        """Bridges that are off at rest and in gain."""
        del parts
        return self._virtual(rng, self.factor, 0.0)
