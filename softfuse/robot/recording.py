"""How recordings of the robot are written, as far as it is not found in the file, or found wrongly."""

import codecs
from typing import Annotated, Literal, Self

from annotated_types import Gt
from pydantic import AfterValidator, ConfigDict, model_validator

from softfuse.io.quantity import Frequency, wrong_value
from softfuse.io.settings import FileSettings, Settings


def _known_encoding(name: str) -> str:
    try:
        codecs.lookup(name)
    except LookupError:
        raise wrong_value('is no encoding: use one such as "utf-8", "utf-16" or "cp1252"') from None
    return name


class RecordingSettings(Settings):
    """A table of readings: separator between fields, " " for any blanks; decimal point or comma; encoding.

    time, time_unit: its column and unit; rate in Hz: of rows whose time is not written or wrong; columns:
    recording's name -> softfuse's channel; layout "long": a row is a reading, of the channel in the column
    `id`, its value in the column `value`.
    """

    separator: Literal[",", ";", "\t", " ", ":", "|"] | None = None
    decimal: Literal[".", ","] | None = None
    encoding: Annotated[str, AfterValidator(_known_encoding)] | None = None
    time: str | None = None
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    rate: Annotated[Frequency, Gt(0)] | None = None
    columns: dict[str, str] = {}
    layout: Literal["wide", "long"] | None = None
    id: str | None = None
    value: str | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.separator is not None and self.separator == self.decimal:
            raise wrong_value("is the separator as well: one of them is another sign", key="decimal")
        names = list(self.columns.values())
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise wrong_value(f'name "{min(twice)}" twice: a channel is in one column', key="columns")
        for key in ("id", "value"):
            if getattr(self, key) is not None and self.layout == "wide":
                raise wrong_value('is of the layout "long": remove this key, or change layout', key=key)
        return self


class RecordingFile(FileSettings):
    """A file of which only the table [recording] matters: the configuration of a robot, or less."""

    model_config = ConfigDict(extra="ignore")

    recording: RecordingSettings
