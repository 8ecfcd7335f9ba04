"""Tensions of cables, by load cells: what actuators pull with, measured."""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, model_validator

from softfuse.io.quantity import FORCE, PositiveForce
from softfuse.mechanics.reading import DriveReading
from softfuse.sensors.base import Names
from softfuse.sensors.direct import Scaled, ScaledSettings


class CableTensionSettings(ScaledSettings):
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

    @property
    def _errors(self):
        return self.noise, self.offset_sigma, 0.0

    def _scaled(self, parts):
        """Raises ConfigError for a cable that there is not."""
        parts.cables_of(self.name, self.cables)
        return Scaled(self.cables, ("N",), self.unit, driven_above=self.slack)

    def functional(self, parts):
        """The tensions."""
        return DriveReading(tuple(cable.drive for cable in parts.cables_of(self.name, self.cables)))
