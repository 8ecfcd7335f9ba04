"""Flow sensors and crossed lines of electrodes, and the columns of a recording in which they write."""

from typing import Any, Literal, Self

from pydantic import model_validator

from softfuse.io.quantity import wrong_value
from softfuse.sensors.base import Names
from softfuse.sensors.crossed import settings as crossed
from softfuse.sensors.flow import sensor as flow


class FlowSettings(flow.FlowSettings):
    """Flow sensors, one on each cavity, in the order of [[cavity]]."""

    type: Literal["D6F-P0001A1"]  # pyright: ignore
    name: str = "flow"

    @model_validator(mode="before")
    @classmethod
    def _of_cavities(cls, data: Any) -> Any:
        return one_each(data, "chambers") | {"part": "D6F-P0001A1"} if isinstance(data, dict) else data


class CapacitiveSettings(crossed.CrossedSettings):
    """A single-ended array of crossed lines of diamonds, of which rows and columns are named apart."""

    type: Literal["crossed-diamonds"]  # pyright: ignore
    name: str = "electrode"
    contact: str = "contact"
    row_channels: Names
    column_channels: Names

    @model_validator(mode="before")
    @classmethod
    def _of_both(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        return {"channels": [*data.get("row_channels", ()), *data.get("column_channels", ())]} | data

    @property
    def lines(self) -> tuple[str, ...]:
        """Channels of all lines, rows first."""
        return (*self.row_channels, *self.column_channels)

    @model_validator(mode="after")
    def _check_channels(self) -> Self:
        for key, lines, channels in (
            ("row_y", self.row_y, self.row_channels),
            ("column_x", self.column_x, self.column_channels),
        ):
            if len(lines) != len(channels):
                name = f"{key.split('_')[0]}_channels"
                raise wrong_value(
                    f"names {len(channels)} columns for the {len(lines)} positions of {key}", key=name
                )
        return self


def one_each(data: dict[str, Any], key: str) -> dict[str, Any]:
    """Settings in which each channel belongs to the part of its number."""
    return {key: [str(k) for k in range(len(data.get("channels", ())))]} | data
