"""Tensions of cables, by load cells: what actuators pull with, measured."""

from typing import Annotated, Literal, Self

import jax.numpy as jnp
import numpy as np
from pydantic import BeforeValidator, model_validator

from softfuse.io.quantity import FORCE, PositiveForce
from softfuse.mechanics.reading import DriveReading
from softfuse.sensors.base import Names
from softfuse.sensors.direct import DirectSettings, Scale


class CableTensionSettings(DirectSettings):
    """Load cells on cables, one channel for each, `unit` of force for each one of it.

    noise, offset_sigma: of a reading and of its zero in N; slack in N: a cable that pulls by less leaves the
    body at rest.
    """

    type: Literal["cable-tension"] = "cable-tension"
    cables: Names
    unit: Annotated[float, BeforeValidator(FORCE.parse)] = 1.0
    noise: PositiveForce = 0.02
    offset_sigma: PositiveForce = 0.05
    slack: PositiveForce = 0.5
    tared: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        self._one_each("channels", self.channels, len(self.cables))
        return self

    def sensor(self, parts):
        """Raises ConfigError for a cable that there is not."""
        parts.cables_of(self.name, self.cables)
        return self._direct(
            self.cables,
            Scale(jnp.asarray(self.unit, float)),
            0.0,
            units=("N",),
            noise=self.noise,
            offset_sigma=self.offset_sigma,
            drift=0.0,
            driven_above=self.slack,
        )

    def functional(self, parts):
        """The tensions."""
        return DriveReading(tuple(cable.drive for cable in parts.cables_of(self.name, self.cables)))

    def ideal(self, parts, time_s, values):
        """Of tensions (m, b) N."""
        del parts, time_s
        return np.asarray(values) / self.unit

    def electronics(self, parts, rng):
        """Cells that differ in zero and gain."""
        del parts
        return self._virtual(rng, 1.0 / self.unit, noise=self.noise, offset_sigma=self.offset_sigma)
