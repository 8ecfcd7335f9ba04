"""The sensors of a device: a pair that measures deformation and finds contacts, and what there is besides.

Flow sensors on vented cavities go with crossed lines of electrodes or a grid of mutual capacitances,
pressure sensors on sealed cavities with single electrodes, because a flow's zero is taken by the one's touch
and a pressure's zero by the other's.
"""

from typing import Self, TypeVar

from pydantic import Field, model_validator

from softfuse.config.mutual import MutualSettings
from softfuse.config.sealed_sensors import CableLengthSettings, ElectrodeSettings, PressureSettings
from softfuse.config.sensors import CapacitiveSettings, FlowSettings
from softfuse.errors import ConfigError
from softfuse.io.quantity import wrong_value
from softfuse.io.settings import FileSettings, Settings

_S = TypeVar("_S", bound=Settings)

_PAIRS = (("flow", "capacitive"), ("flow", "mutual"), ("pressure", "electrodes"))


class SensorSettings(FileSettings):
    """All sensors of the device: flow and capacitive or mutual, or pressure and electrodes and perhaps cable.

    `vented`, `crossed`, `grid`, `sealed`, `single` are None for those that the device does not have; `flow`,
    `capacitive`, `mutual`, `pressure`, `electrodes` are for those who need it.
    """

    vented: FlowSettings | None = Field(default=None, alias="flow")
    crossed: CapacitiveSettings | None = Field(default=None, alias="capacitive")
    grid: MutualSettings | None = Field(default=None, alias="mutual")
    sealed: PressureSettings | None = Field(default=None, alias="pressure")
    single: ElectrodeSettings | None = Field(default=None, alias="electrodes")
    cable: CableLengthSettings | None = None

    @property
    def flow(self) -> FlowSettings:
        """The flow sensors; raises ConfigError when the device has none."""
        return self._given(self.vented, "flow")

    @property
    def capacitive(self) -> CapacitiveSettings:
        """The crossed electrodes; raises ConfigError when the device has none."""
        return self._given(self.crossed, "capacitive")

    @property
    def mutual(self) -> MutualSettings:
        """The grid of mutual capacitances; raises ConfigError when the device has none."""
        return self._given(self.grid, "mutual")

    @property
    def pressure(self) -> PressureSettings:
        """The pressure sensors; raises ConfigError when the device has none."""
        return self._given(self.sealed, "pressure")

    @property
    def electrodes(self) -> ElectrodeSettings:
        """The single electrodes; raises ConfigError when the device has none."""
        return self._given(self.single, "electrodes")

    def _given(self, settings: _S | None, key: str) -> _S:
        if settings is None:
            raise ConfigError(f"{self.path}: sensors.{key}: missing, there is {_listing(self._keys)}")
        return settings

    @property
    def _keys(self) -> set[str]:
        fields = type(self).model_fields
        return {fields[name].alias or name for name in fields if getattr(self, name) is not None}

    @property
    def groups(self) -> tuple[tuple[tuple[str, ...], float], ...]:
        """Columns of each group of readings in the order of the device's senses, and their unit in SI.

        Flow [V], rows and columns or cells [counts]; or pressures [V], their supply [V], electrodes
        [counts], cables, which are recorded in mm.
        """
        if self.vented and self.grid:
            return (self.vented.channels, 1.0), (self.grid.channels, 1.0)
        if self.vented:
            crossed = self.capacitive
            return (self.vented.channels, 1.0), (crossed.row_channels, 1.0), (crossed.column_channels, 1.0)
        supply = self.pressure.reference_channel
        cables = self.cable.channels if self.cable else ()
        return (
            (self.pressure.channels, 1.0),
            (() if supply is None else (supply,), 1.0),
            (self.electrodes.channels, 1.0),
            (cables, 1e-3),
        )

    @property
    def channels(self) -> tuple[str, ...]:
        """Columns that a recording must have, time apart."""
        return tuple(name for names, _ in self.groups for name in names)

    @model_validator(mode="after")
    def _check(self) -> Self:
        pair = self._keys - {"cable"}
        if pair not in [set(each) for each in _PAIRS]:
            raise wrong_value(
                "give either [sensors.flow] and [sensors.capacitive] or [sensors.mutual], or "
                f"[sensors.pressure] and [sensors.electrodes]; there is {_listing(pair)}"
            )
        if self.cable and self.vented:
            raise wrong_value("goes with [sensors.pressure] and [sensors.electrodes] only", key="cable")
        twice = {name for name in self.channels if self.channels.count(name) > 1}
        if twice:
            raise wrong_value(f'two sensors write in the column "{min(twice)}": give each its own')
        return self

    def check_counts(self, cavities: int, electrodes: int, cables: int) -> None:
        """Raise the error of a validator unless there is a channel for each."""
        for key, settings, what, count in (
            ("flow", self.vented, "flow sensors for {} cavities", cavities),
            ("pressure", self.sealed, "pressure sensors for {} cavities", cavities),
            ("electrodes", self.single, "channels for {} electrodes", electrodes),
            ("cable", self.cable, "channels for {} cables", cables),
        ):
            if settings is not None and len(settings.channels) != count:
                raise wrong_value(
                    f"{len(settings.channels)} {what.format(count)}: name one column for each",
                    key=f"sensors.{key}.channels",
                )


def _listing(keys: set[str]) -> str:
    order = ("flow", "capacitive", "mutual", "pressure", "electrodes")
    return " and ".join(f"[sensors.{key}]" for key in order if key in keys) or "neither"
