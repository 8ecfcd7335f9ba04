"""Which column is the time, and in which unit, by its name, the line of units, or how far it steps."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softfuse.hardware.table.form import PER_SECOND, TableForm

_SPELT = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nsec", "nanosecond", "nanoseconds"),
}
_UNITS = {spelt: unit for unit, names in _SPELT.items() for spelt in names}
_STEMS = frozenset(
    ("", "t", "time", "times", "timestamp", "time stamp", "timestamps", "elapsed", "elapsed time", "runtime")
    + ("uptime", "zeit", "device time", "host time", "sample time", "board time", "relative time")
)
_PLAUSIBLE_S = (2e-5, 0.5)
"""Sampling intervals that are believed [s]: 50 kHz to 2 Hz."""


def time_name(name: str) -> bool:
    """Whether a column of that name is a time."""
    return _parsed(name) is not None


def _parsed(name: str) -> str | None:
    """The unit that a column of time names, "" for none; None when it is no time."""
    words = [word for word in re.split(r"[\s_()\[\]/.,:-]+", name.strip().lower()) if word]
    unit = _UNITS.get(words[-1], "") if words else ""
    stem = " ".join(words[:-1] if unit else words)
    # A single capital is a temperature or a tension.
    known = stem in _STEMS and bool(words) and not (stem == "t" and name.strip().startswith("T"))
    return unit if known and (stem or name.strip().lower() != "s") else None


@dataclass(frozen=True)
class TimeColumn:
    """Where the time is, by the number of its field, how many of its units are a second, and what is to be
    said of that.
    """

    place: int
    per_second: float
    remark: str | None


def find_time(names: Sequence[str], told: TableForm) -> int | None:
    """The number of the field of the time: the told one, else `time_s`, else the first that is one by its
    name; None where there is none.
    """
    if told.time is not None:
        return names.index(told.time) if told.time in names else None
    if "time_s" in names:
        return names.index("time_s")
    return next((k for k, name in enumerate(names) if time_name(name)), None)


def time_column(
    place: int, name: str, units: Sequence[str], first: Sequence[float], told: TableForm
) -> TimeColumn:
    """The column of the time at a place with a name, of which the first values are known.

    Its unit is the told one, that in the line of units, or that in its name; without any, the first of s, ms,
    µs that makes a sampling interval that can be.
    """
    below = units[place].lower() if place < len(units) else ""
    unit = told.time_unit or _UNITS.get(below) or _parsed(name) or None
    with np.errstate(over="ignore"):
        steps = np.diff([value for value in first if np.isfinite(value)])
    steps = steps[steps > 0]
    if not steps.size:
        return TimeColumn(place, PER_SECOND[unit or "s"], None)
    with np.errstate(over="ignore"):
        step = float(np.median(steps))
    low, high = _PLAUSIBLE_S
    likely = next((u for u, per in PER_SECOND.items() if low <= step / per <= high), None)
    taken = unit or likely or "s"
    if low <= step / PER_SECOND[taken] <= high and (unit or likely == "s"):
        return TimeColumn(place, PER_SECOND[taken], None)
    if unit is None and likely:
        remark = f"its unit is taken to be {likely}, since it steps by {step:g}: say time_unit if it is not"
    else:
        remark = f"it steps by {step / PER_SECOND[taken]:g} s, which is no likely sampling interval"
        if told.time_unit is None:
            remark += (
                f': say time_unit = "{likely}" if it is in {likely}' if likely else ": say its time_unit"
            )
    return TimeColumn(place, PER_SECOND[taken], f"the time {name!r}: {remark}")
