"""A whole device, the top of a configuration file."""

from pathlib import Path
from typing import Annotated, Any, Self

from annotated_types import Ge
from pydantic import Field, PrivateAttr, model_validator

from softfuse.config.body import BodySettings
from softfuse.config.contact import ContactSettings
from softfuse.config.quantity import Number, PositiveInteger, PositiveNumber, wrong_value
from softfuse.config.sensors import SensorSettings
from softfuse.config.settings import Settings, Vector


class NameSettings(Settings):
    """What people call the device."""

    name: str


class CavitySettings(Settings):
    """A cavity's name and a point (3,) m in it; their order in the file is their order everywhere."""

    name: str
    centre: Vector


class EstimatorSettings(Settings):
    """Estimate step: linearisations per frame, ε [1/N²] of ε‖ΔF‖² in the cost, doubted misfit.

    poor_fit: a largest misfit above this part of the largest volume change is flagged.
    """

    steps_per_frame: PositiveInteger = 1
    regularisation: Annotated[Number, Ge(0)] = 1e-6
    poor_fit: PositiveNumber = 0.25


class DeviceConfig(Settings):
    """A validated configuration, in SI; contact and sensors are only needed by what uses them."""

    device: NameSettings
    body: BodySettings
    cavities: tuple[CavitySettings, ...] = Field(default=(), alias="cavity")
    contact: ContactSettings | None = None
    sensors: SensorSettings | None = None
    estimator: EstimatorSettings = EstimatorSettings()

    _path: Path = PrivateAttr(default=Path("config"))

    def model_post_init(self, context: Any, /) -> None:
        """Remember where the configuration comes from, for messages."""
        if context:
            self._path = context["path"]

    @property
    def path(self) -> Path:
        """The file that the configuration comes from."""
        return self._path

    @model_validator(mode="after")
    def _check_cavities(self) -> Self:
        count = len(self.cavities)
        names = [cavity.name for cavity in self.cavities]
        for k, name in enumerate(names):
            if name in names[:k]:
                raise wrong_value(
                    f'the name "{name}" is taken by cavity[{names.index(name)}]', key=f"cavity[{k}].name"
                )
        if self.sensors is not None and len(self.sensors.flow.channels) != count:
            given = len(self.sensors.flow.channels)
            raise wrong_value(
                f"{given} flow sensors for {count} cavities: name one column for each",
                key="sensors.flow.channels",
            )
        self.body.source.check_cavities([cavity.centre for cavity in self.cavities])
        return self
