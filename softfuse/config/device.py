"""A whole device, the top of a configuration file."""

from collections.abc import Sequence
from typing import Annotated, Self

from annotated_types import Ge
from pydantic import Field, model_validator

from softfuse.config.attached import (
    CableSettings,
    CentrelineSettings,
    ElectrodePlace,
    GasSettings,
    PointSettings,
)
from softfuse.config.body import BodySettings
from softfuse.config.calibration import CalibrationSettings
from softfuse.config.contact import AnyContact, DiscSettings, PatchSettings
from softfuse.config.quantity import (
    Integer,
    Number,
    PositiveInteger,
    PositiveLength,
    PositiveNumber,
    wrong_value,
)
from softfuse.config.reduction import ReductionSettings
from softfuse.config.sensor_set import SensorSettings
from softfuse.config.settings import ExistingFile, FileSettings, Settings, Vector
from softfuse.config.source import AnySource, check_sources


class NameSettings(Settings):
    """What people call the device."""

    name: str


class CavitySettings(Settings):
    """A cavity's name and a point (3,) m in it; their order in the file is their order everywhere.

    shift, growth (3,) m: how the cavity of the device that was made differs from the one drawn, in place and
    in length along x, y and z; the mesh follows (softfuse/mesh/morph.py).
    """

    name: str
    centre: Vector
    shift: Vector = (0.0, 0.0, 0.0)
    growth: Vector = (0.0, 0.0, 0.0)


class EstimatorSettings(Settings):
    """Estimate step: linearisations per frame, ε [1/N²] of ε‖ΔF‖² in the cost, doubted misfit, longest step.

    model_error: part of a reading by which the model may be wrong; reading_spread: file of how uncertain
    readings are by parameters and places; a calibration finds both; poor_fit: a largest misfit above this
    part of the largest reading is flagged; largest_motion in m: a step
    that would move a node further is shortened, None for any; catch_up_steps: further ones in the same frame
    at most, while they have to be shortened.
    """

    steps_per_frame: PositiveInteger = 1
    regularisation: Annotated[Number, Ge(0)] = 1e-6
    model_error: Annotated[Number, Ge(0)] = 0.0
    reading_spread: ExistingFile | None = None
    poor_fit: PositiveNumber = 0.25
    largest_motion: PositiveLength | None = None
    catch_up_steps: Annotated[Integer, Ge(0)] = 0


class DeviceConfig(FileSettings):
    """A validated configuration, in SI; all but device and body is only needed by what uses it."""

    device: NameSettings
    body: BodySettings
    cavities: tuple[CavitySettings, ...] = Field(default=(), alias="cavity")
    cables: tuple[CableSettings, ...] = Field(default=(), alias="cable")
    gas: GasSettings | None = None
    electrodes: tuple[ElectrodePlace, ...] = Field(default=(), alias="electrode")
    points: tuple[PointSettings, ...] = Field(default=(), alias="point")
    centreline: CentrelineSettings | None = None
    contact: AnyContact | None = None
    sensors: SensorSettings | None = None
    sources: tuple[AnySource, ...] = Field(default=(), alias="source")
    estimator: EstimatorSettings = EstimatorSettings()
    reduction: ReductionSettings = ReductionSettings()
    calibration: CalibrationSettings = CalibrationSettings()

    @model_validator(mode="after")
    def _check_parts(self) -> Self:
        for key, parts in (
            ("cavity", self.cavities),
            ("cable", self.cables),
            ("electrode", self.electrodes),
            ("point", self.points),
        ):
            _check_names(key, [part.name for part in parts])
        self.body.source.check_cavities([cavity.centre for cavity in self.cavities])
        if self.gas is not None:
            self.gas.check_cavities(len(self.cavities))
        if self.contact is not None:
            self.contact.check_electrodes(self.electrodes)
        check_sources(self.sources)
        return self

    @model_validator(mode="after")
    def _check_sensors(self) -> Self:
        if self.sensors is None:
            return self
        self.sensors.check_counts(len(self.cavities), len(self.electrodes), len(self.cables))
        if self.sensors.vented and self.gas:
            raise wrong_value(
                "flow sensors are on vented cavities, [gas] seals them: remove one", key="sensors.flow"
            )
        if self.sensors.sealed and not self.gas:
            raise wrong_value(
                "pressures are those of sealed cavities: add [gas] with dead_volume", key="sensors.pressure"
            )
        if self.contact is not None and bool(self.sensors.single) != isinstance(self.contact, PatchSettings):
            raise wrong_value(
                'electrodes tell which "patch" is pressed, crossed lines where a "punch" or "uniform" is: '
                "change model, or the sensors",
                key="contact.model",
            )
        most = self.sensors.grid.touches if self.sensors.grid else 1
        if isinstance(self.contact, DiscSettings) and self.contact.max_contacts > most:
            raise wrong_value(
                f"{self.contact.max_contacts} contacts at once, but the electrodes tell {most}: "
                "crossed lines find one, a grid ([sensors.mutual]) as many as its touches",
                key="contact.max_contacts",
            )
        return self


def _check_names(key: str, names: Sequence[str]) -> None:
    for k, name in enumerate(names):
        if name in names[:k]:
            raise wrong_value(
                f'the name "{name}" is taken by {key}[{names.index(name)}]', key=f"{key}[{k}].name"
            )
