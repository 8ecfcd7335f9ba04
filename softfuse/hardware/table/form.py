"""What is looked for in a table of readings of which nothing is told, and numbers as texts."""

import math
from collections.abc import Mapping
from typing import Literal

from softfuse.robot.recording import RecordingSettings

Decimal = Literal[".", ","]
SEPARATORS = ("\t", ";", ",", "|", " ")
"""Those that are looked for; a blank stands for any run of blanks."""
PER_SECOND: Mapping[str, float] = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
MISSING = frozenset(
    {"", "-", "--", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "inf", "-inf", "+inf"}
)
"""Fields, in small letters, that say that there is no reading."""


FOUND = RecordingSettings()
"""Nothing is told of how a table is written."""


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
