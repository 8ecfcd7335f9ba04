"""What a channel of a sensor with an electrical output carries: volts, or counts of a digital output.

Settings of such sensors write voltages with their unit where the output is in volts, plain numbers where it
is digital; constants of a part that is named stand for keys left out.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from annotated_types import Ge, Gt
from pydantic import BeforeValidator, ValidationInfo, model_validator

from softfuse.io.quantity import (
    VOLTAGE,
    VOLTAGE_WALK,
    Dimension,
    PositiveInteger,
    shown,
    wrong_value,
)
from softfuse.sensors.base import Gains, Names, SensorSettings
from softfuse.sensors.electronics import ChannelElectronics, Values, equal_channels


def in_output(volts: Dimension, digital: Dimension | None = None) -> BeforeValidator:
    """Reads a quantity in the output's unit: of one dimension for volts, of another or none else."""

    def parse(value: Any, info: ValidationInfo) -> float:
        if info.data.get("output", "volts") == "volts":
            return volts.parse(value)
        if digital is not None:
            return digital.parse(value)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise wrong_value(f"{shown(value)} is no plain number, as the output is digital")
        return float(value)

    return BeforeValidator(parse)


Raw = Annotated[float, in_output(VOLTAGE)]
"""A reading in V, or a plain number."""

PositiveRaw = Annotated[Raw, Gt(0)]

RawSpread = Annotated[Raw, Ge(0)]

RawWalk = Annotated[float, in_output(VOLTAGE_WALK), Ge(0)]
"""A random walk in V/√s, or in 1/√s of plain numbers."""


class PartSettings(SensorSettings):
    """Sensors of one kind on `chambers`, one channel for each; keys left out are those of the `part`.

    output: what channels carry; gain [-]: what is measured over what there is, one value or one for each
    chamber; low, high: readings at or beyond are clipped; noise of a reading; bits, full_scale: of the
    converter.
    """

    known_parts: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    quantity: ClassVar[str]
    """Of a chamber, see `quantities`."""

    chambers: Names
    part: str | None = None
    output: Literal["volts", "counts"] = "volts"
    gain: Gains = (1.0,)
    low: Raw
    high: Raw
    noise: PositiveRaw
    bits: PositiveInteger
    full_scale: PositiveRaw

    @model_validator(mode="before")
    @classmethod
    def _of_part(cls, data: Any) -> Any:
        """Constants of the part; a validator's error where it is not known."""
        if not isinstance(data, Mapping) or data.get("part") is None:
            return data
        if data["part"] not in cls.known_parts:
            known = ", ".join(cls.known_parts)
            raise wrong_value(
                f"{shown(data['part'])} is none of {known}: leave it out and give its constants", key="part"
            )
        return {**cls.known_parts[data["part"]], **data}

    @model_validator(mode="after")
    def _check_counts(self) -> Self:
        self._one_each("gain", self.gain, len(self.channels))
        self._count(len(self.chambers), f"{len(self.chambers)} chambers")
        return self

    @property
    def quantities(self):
        """One of each chamber."""
        return (self.quantity,) * len(self.chambers)

    @property
    def readings(self) -> tuple[str, ...]:
        """Their names, one for each chamber."""
        return tuple(f"{self.name} {chamber}" for chamber in self.chambers)

    def _converted(self, **own: Values) -> ChannelElectronics:
        """Virtual parts on the converter; own: what else they have of `equal_channels`."""
        step = self.full_scale / 2**self.bits
        ends = {"low": 0.0, "high": self.full_scale - step}
        return equal_channels(len(self.columns), noise=self.noise, step=step, **ends, **own)
