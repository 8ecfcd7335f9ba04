"""Pressure sensors, electrodes and cables' lengths, and the columns of a recording in which they write."""

from typing import Any, Literal

from pydantic import model_validator

from softfuse.config.sensors import one_each
from softfuse.sensors import cable_length
from softfuse.sensors.electrodes import sensor as electrodes
from softfuse.sensors.pressure import sensor as pressure


class PressureSettings(pressure.PressureSettings):
    """Pressure sensors, one on each sealed cavity, in the order of [[cavity]]."""

    type: Literal["MPX5100A", "MPX5100D", "MPX5100G"]  # pyright: ignore
    name: str = "pressure"

    @model_validator(mode="before")
    @classmethod
    def _of_cavities(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        old = {"supply": "reference", "supply_channel": "reference_channel"}
        data = {old.get(key, key): value for key, value in data.items()}
        return one_each(data, "chambers") | {"part": data.get("type")}


class ElectrodeSettings(electrodes.ElectrodeSettings):
    """Single-ended electrodes, in the order of [[electrode]]."""

    name: str = "electrode"
    contact: str = "contact"

    @model_validator(mode="before")
    @classmethod
    def _of_places(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        place = {"name": "", "centre": ["0 mm", "0 mm", "0 mm"], "direction": [0, 0, 1]}
        return {"electrodes": [place for _ in data.get("channels", ())]} | data


class CableLengthSettings(cable_length.CableLengthSettings):
    """By how much each cable has been shortened, read in mm, in the order of [[cable]]."""

    name: str = "cable length"

    @model_validator(mode="before")
    @classmethod
    def _of_cables(cls, data: Any) -> Any:
        return one_each(data, "cables") if isinstance(data, dict) else data
