"""A robot as a TOML file describes it: body, actuators, contacts, sensors and what is around it."""

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from annotated_types import Ge
from jaxtyping import Float
from pydantic import Field, model_validator

from softfuse.errors import ConfigError
from softfuse.io.quantity import Integer, Number, PositiveInteger, PositiveLength, PositiveNumber, wrong_value
from softfuse.io.settings import ExistingFile, FileSettings, Settings
from softfuse.robot.actuators import CableSettings, ChamberSettings, EnvironmentSettings
from softfuse.robot.body import BodySettings
from softfuse.robot.contacts import AnyContact
from softfuse.robot.points import CentrelineSettings, PointSettings
from softfuse.robot.recording import RecordingSettings
from softfuse.robot.reduction import ReductionSettings
from softfuse.robot.source import AnySource, check_sources
from softfuse.robot.tolerances import CalibrationSettings
from softfuse.sensors.base import SensorSettings
from softfuse.sensors.registry import SENSORS


class NameSettings(Settings):
    """What people call the robot."""

    name: str


_Kind = TypeVar("_Kind", bound=SensorSettings)

AnySensor = Annotated[reduce(or_, SENSORS.values()), Field(discriminator="type")]
"""One of the kinds of sensors that there are."""


BySensor = Annotated[Number, Ge(0)] | dict[str, Annotated[Number, Ge(0)]]
"""A number of each sensor, by its name, or of all."""


class EstimatorSettings(Settings):
    """Estimate step: linearisations per frame, ε [1/N²] of ε‖ΔF‖² in the cost, doubted misfit, longest step.

    model_error: part of a reading by which the model may be wrong, beyond what sensors say of it, None: not
    known; model_error_floor: a smaller reading counts as one of this size, a part of the sensor's largest;
    both of each sensor by its name, or of all, and 0 and 0.03 of a sensor that is not named; reading_spread:
    file of how uncertain readings are by parameters and places; a calibration finds all three; poor_fit: a
    largest misfit above this part of the largest reading is flagged; largest_motion in m: a step that would
    move a node further is shortened, None for any; catch_up_steps: further ones in the same frame at most,
    while they have to be shortened.
    """

    steps_per_frame: PositiveInteger = 1
    regularisation: Annotated[Number, Ge(0)] = 1e-6
    model_error: BySensor | None = None
    model_error_floor: BySensor = Field(default_factory=dict)
    reading_spread: ExistingFile | None = None
    poor_fit: PositiveNumber = 0.25
    largest_motion: PositiveLength | None = None
    catch_up_steps: Annotated[Integer, Ge(0)] = 0


class RobotSettings(FileSettings):
    """A validated robot, in SI; all but its name and body is only needed by what uses it."""

    robot: NameSettings
    body: BodySettings
    environment: EnvironmentSettings = EnvironmentSettings()
    chambers: tuple[ChamberSettings, ...] = Field(default=(), alias="chamber")
    cables: tuple[CableSettings, ...] = Field(default=(), alias="cable")
    contacts: tuple[AnyContact, ...] = Field(default=(), alias="contact")
    sensors: tuple[AnySensor, ...] = Field(default=(), alias="sensor")
    points: tuple[PointSettings, ...] = Field(default=(), alias="point")
    centreline: CentrelineSettings | None = None
    sources: tuple[AnySource, ...] = Field(default=(), alias="source")
    estimator: EstimatorSettings = EstimatorSettings()
    reduction: ReductionSettings = ReductionSettings()
    recording: RecordingSettings = RecordingSettings()
    calibration: CalibrationSettings = CalibrationSettings()

    @property
    def places(self) -> dict[str, Float[np.ndarray, "3 3"]]:
        """The places that have a name, those of electrodes, by it."""
        return {seen.name: seen.place for sensor in self.sensors for seen in sensor.places}

    def contact(self, name: str | None = None) -> AnyContact:
        """The contact of a name, the only one without; raises ConfigError where there is none, or several."""
        names = [each.name for each in self.contacts]
        if name is None and len(names) == 1:
            return self.contacts[0]
        if not names:
            raise ConfigError(f"{self.path}: contact: missing, this needs something that may press")
        if name not in names:
            known = ", ".join(f'"{each}"' for each in names)
            raise ConfigError(f"{self.path}: contact: say which one is meant: there is {known}")
        return self.contacts[names.index(name)]

    def meshed(self, keys: Mapping[str, Any]) -> Self:
        """The same with other keys [SI] of the body's source."""
        source = self.body.source.model_copy(update=keys)
        return self.model_copy(update={"body": self.body.model_copy(update={"source": source})})

    def finer(self, times: float) -> Self:
        """The same with a mesh of so many times shorter edges, as far as these are configured."""
        source = self.body.source
        return self.meshed({key: getattr(source, key) / times for key in source.edges})

    def sensors_of(self, kind: type[_Kind]) -> tuple[_Kind, ...]:
        """The sensors of a kind."""
        return tuple(sensor for sensor in self.sensors if isinstance(sensor, kind))

    @property
    def commands(self) -> tuple[str, ...]:
        """The columns of a recording that hold what actuators are commanded to."""
        each = (part.command for part in (*self.cables, *self.chambers))
        return tuple(command.channel for command in each if command is not None)

    @property
    def channels(self) -> tuple[str, ...]:
        """The columns that a recording must have, time apart: those of the sensors, then commands."""
        return (*(name for sensor in self.sensors for name in sensor.columns), *self.commands)

    @model_validator(mode="after")
    def _check(self) -> Self:
        named = {
            "chamber": self.chambers,
            "cable": self.cables,
            "contact": self.contacts,
            "sensor": self.sensors,
            "point": self.points,
        }
        for key, parts in named.items():
            _check_names(key, [part.name for part in parts])
        _check_places(self.sensors)
        for key in ("model_error", "model_error_floor"):
            given = getattr(self.estimator, key)
            for name in given if isinstance(given, dict) else ():
                if name not in {each.name for each in self.sensors}:
                    raise wrong_value(f'there is no sensor "{name}"', key=f"estimator.{key}")
        channels = self.channels
        twice = {name for name in channels if channels.count(name) > 1}
        if twice:
            raise wrong_value(
                f'"{min(twice)}" is the column of two sensors or commands: give each its own', key="sensor"
            )
        self.body.source.check_cavities([chamber.centre for chamber in self.chambers])
        check_sources(self.sources)
        return self


def _check_names(key: str, names: Sequence[str]) -> None:
    for k, name in enumerate(names):
        if name in names[:k]:
            raise wrong_value(
                f'the name "{name}" is taken by {key}[{names.index(name)}]', key=f"{key}[{k}].name"
            )


def _check_places(sensors: Sequence[SensorSettings]) -> None:
    """Raise the error of a validator for two electrodes of one name: it names their place."""
    taken: dict[str, str] = {}
    for k, sensor in enumerate(sensors):
        for seen in sensor.places:
            key = f"sensor[{k}].{seen.key}"
            if seen.name in taken:
                told = f'the name "{seen.name}" is taken by {taken[seen.name]}'
                raise wrong_value(told, key=f"{key}.name")
            taken[seen.name] = key
