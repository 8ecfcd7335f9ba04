"""What may be told about how a table of readings is written, and numbers as texts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Decimal = Literal[".", ","]
Unit = Literal["s", "ms", "us", "ns"]
SEPARATORS = ("\t", ";", ",", "|", " ")
"""Those that are looked for; a blank stands for any run of blanks."""
PER_SECOND: Mapping[str, float] = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
MISSING = frozenset(
    {"", "-", "--", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "inf", "-inf", "+inf"}
)
"""Fields, in small letters, that say that there is no reading."""


@dataclass(frozen=True)
class TableForm:
    """How a table is written; what is None is found in the file."""

    separator: str | None = None
    decimal: Decimal | None = None
    """The decimal point or comma."""
    encoding: str | None = None
    time: str | None = None
    """The column of the time."""
    time_unit: Unit | None = None
    rate: float | None = None
    """Rows per second [Hz]; whatever the file says of the time does not count then."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Name in the file -> name of the channel; others keep theirs."""
    layout: Literal["wide", "long"] | None = None
    """A column for each channel, or a row for each reading: its time, which channel, its value."""
    id: str | None = None
    """In a long table, the column that says which channel."""
    value: str | None = None
    """In a long table, the column of the reading."""


FOUND = TableForm()
"""Nothing is told."""


def number(text: str, decimal: Decimal) -> float | None:
    """The finite number that a field is, else None; Python's own 1_000 is none."""
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if "_" in text:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def missing(text: str) -> bool:
    """Whether a field says that there is no reading."""
    return text.strip().lower() in MISSING
