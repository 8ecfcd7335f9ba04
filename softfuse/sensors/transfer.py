"""What a channel of a sensor with an electrical output carries: volts, or counts of a digital output.

Settings of such sensors write voltages with their unit where the output is in volts, plain numbers where it
is digital. `output` must be the first of their keys; constants of a part that is named stand for keys left
out.
"""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Ge, Gt
from pydantic import BeforeValidator, ValidationInfo, model_validator

from softfuse.io.quantity import VOLTAGE, VOLTAGE_WALK, Dimension, PositiveNumber, shown, wrong_value
from softfuse.io.settings import NotEmpty, listed
from softfuse.sensors.base import Names, SensorSettings


def number(value: Any) -> float:
    """A plain number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong_value(f"{shown(value)} is no plain number, as the output is digital")
    return float(value)


def in_output(volts: Dimension, digital: Dimension | None = None) -> BeforeValidator:
    """Reads a quantity in the output's unit: of one dimension for volts, of another or none else."""

    def parse(value: Any, info: ValidationInfo) -> float:
        if info.data.get("output", "volts") == "volts":
            return volts.parse(value)
        return number(value) if digital is None else digital.parse(value)

    return BeforeValidator(parse)


def of_part(data: Any, parts: Mapping[str, Mapping[str, Any]]) -> Any:
    """Settings with the constants of the part that they name; a validator's error where it is not known."""
    if not isinstance(data, Mapping) or data.get("part") is None:
        return data
    part = data["part"]
    if part not in parts:
        known = ", ".join(parts)
        raise wrong_value(
            f"{shown(part)} is none of {known}: leave it out and give its constants", key="part"
        )
    return {**parts[part], **data}


Raw = Annotated[float, in_output(VOLTAGE)]
"""A reading in V, or a plain number."""

PositiveRaw = Annotated[Raw, Gt(0)]

RawSpread = Annotated[Raw, Ge(0)]

RawWalk = Annotated[float, in_output(VOLTAGE_WALK), Ge(0)]
"""A random walk in V/√s, or in 1/√s of plain numbers."""


class PartSettings(SensorSettings):
    """Sensors on chambers, one channel for each, all of one part; gain [-]: what is measured over what there
    is, one value or one for each chamber.
    """

    quantity: ClassVar[str]
    """Of a chamber, see `quantities`."""

    chambers: Names
    gain: Annotated[tuple[PositiveNumber, ...], NotEmpty, BeforeValidator(listed)] = (1.0,)

    @property
    def quantities(self):
        """One of each chamber."""
        return (self.quantity,) * len(self.chambers)

    @model_validator(mode="after")
    def _check_counts(self) -> Self:
        self._one_each("gain", self.gain, len(self.channels))
        if len(self.chambers) != len(self.channels):
            raise wrong_value(f"{len(self.channels)} for {len(self.chambers)} chambers", key="channels")
        return self
