"""How a table is written, found in its first lines: where the header is, what separates fields, the decimal
point, quotes, and which column is the time. What stands before the header is passed over.

A line of data has numbers, or what stands for missing ones, in at least half of its fields. The header is a
line without any number, as wide as the data that follow at once or after a line of units; of several one that
names what is wanted, then one as wide as most data, then the one that names most, then the first. The unit of
the time is that of its name, of the line of units, or told by how far it steps.
"""

import csv
import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from softfuse.hardware.table.form import PER_SECOND, SEPARATORS, Decimal, missing, number
from softfuse.robot.recording import RecordingSettings

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
_LOOKED_AT = 200
_LONGEST_UNIT = 8
_COMMENTS = ("#", "%", "//")


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


def find_time(names: Sequence[str], told: RecordingSettings) -> int | None:
    """The number of the field of the time: the told one, else `time_s`, else the first that is one by its
    name; None where there is none.
    """
    if told.time is not None:
        return names.index(told.time) if told.time in names else None
    if "time_s" in names:
        return names.index("time_s")
    return next((k for k, name in enumerate(names) if time_name(name)), None)


def time_column(
    place: int, name: str, units: Sequence[str], first: Sequence[float], told: RecordingSettings
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


@dataclass(frozen=True)
class Dialect:
    """How a table is written."""

    separator: str
    decimal: Decimal
    quote: str
    names: tuple[str, ...]
    """Of the fields, blank where they have none; () where no line is a header."""
    units: tuple[str, ...]
    """In the line below the header, () where there is none."""
    start: int
    """Lines before the data."""
    width: int
    """Fields of a row, a blank one after the last separator included."""
    sample: tuple[tuple[str, ...], ...]
    """The fields of the first rows."""

    def fields(self, line: str) -> list[str]:
        """The fields of a line, without the blanks around them."""
        return split(line, self.separator, self.quote)


def split(line: str, separator: str, quote: str) -> list[str]:
    """The fields of a line, without the blanks around them; a quote that does not end has no meaning."""
    if separator == " ":
        line = line.strip()
    if quote in line and line.count(quote) % 2 == 0:
        reader = csv.reader([line], delimiter=separator, quotechar=quote, skipinitialspace=True)
        return [field.strip() for field in next(reader, [])]
    return [field.strip() for field in (line.split() if separator == " " else line.split(separator))]


def is_comment(line: str) -> bool:
    """Whether a line is a remark."""
    return line.lstrip().startswith(_COMMENTS)


def find_dialect(
    block: bytes, told: RecordingSettings, wanted: Collection[str], time: Callable[[str], bool]
) -> Dialect:
    """How the table is written that begins with a block of whole lines.

    wanted: names of columns that should be there; time: whether a column's name is one of a time. What is
    told is not looked for.
    """
    lines = block.decode(errors="replace").split("\n", _LOOKED_AT)[:_LOOKED_AT]
    lines = [line.rstrip("\r").lstrip("\ufeff") for line in lines]
    text = "\n".join(lines)
    present = tuple(sign for sign in SEPARATORS if sign in text) or (",",)
    separators = present if told.separator is None else (told.separator,)
    decimals: tuple[Decimal, ...] = (".", ",") if re.search(r"\d,\d", text) else (".",)
    decimals = decimals if told.decimal is None else (told.decimal,)
    tried = [_fit(lines, s, d, wanted, time) for s in separators for d in decimals]
    return max(tried, key=lambda fit: fit[0])[1]


def _fit(
    lines: Sequence[str],
    separator: str,
    decimal: Decimal,
    wanted: Collection[str],
    time: Callable[[str], bool],
) -> tuple[tuple[float, ...], Dialect]:
    """A dialect, and how well it fits."""
    quote = "'" if any(line.lstrip("#% ").startswith("'") for line in lines) else '"'
    rows = [split(line, separator, quote) if line.strip() else [] for line in lines]
    numbers = [sum(number(field, decimal) is not None for field in row) for row in rows]
    data = [
        bool(n) and 2 * sum(missing(field) or number(field, decimal) is not None for field in row) >= len(row)
        for n, row in zip(numbers, rows, strict=True)
    ]
    data = [yes and not is_comment(line) for yes, line in zip(data, lines, strict=True)]
    widths = Counter(len(row) for row, yes in zip(rows, data, strict=True) if yes)

    def named(k: int) -> int:
        names = _names(lines[k], separator, quote)
        return sum(name in wanted or time(name) for name in names)

    without = [k for k, row in enumerate(rows) if not numbers[k] and any(row)]
    headers = [
        (k, width)
        for k in without
        for width in widths
        if abs(len(rows[k]) - width) <= 1 and _above_data(k, rows, data, width)
    ]
    if not widths:
        headers = [(k, 0) for k in without]
    tells = {k: named(k) for k, _ in headers}
    best = max(headers, key=lambda h: (tells[h[0]] > 0, widths[h[1]], h[1], tells[h[0]]), default=None)
    if best is None:
        width = max(widths, key=lambda w: (widths[w], w), default=0)
        return (0.0,) * 5, Dialect(separator, decimal, quote, (), (), 0, width, ())
    at, width = best
    names = _names(lines[at], separator, quote)
    width = width or len(names)
    following = next((k for k in range(at + 1, len(rows)) if rows[k]), len(rows))
    has_units = any(data[following + 1 :]) and len(rows[following]) == len(rows[at])
    has_units = has_units and all(
        len(field) <= _LONGEST_UNIT and number(field, decimal) is None for field in rows[following]
    )
    has_units = has_units and not all(missing(field) for field in rows[following])
    start = following + 1 if has_units else at + 1
    kept = [k for k in range(start, len(rows)) if rows[k] and not is_comment(lines[k])]
    sample = tuple(tuple(rows[k]) for k in kept)
    fitting = sum(len(row) in (width, width - 1) and data[k] for k, row in zip(kept, sample, strict=True))
    shares = fitting / max(len(kept), 1), sum(numbers[k] for k in kept) / max(len(kept), 1)
    found = Dialect(
        separator,
        decimal,
        quote,
        tuple((names + [""] * width)[: max(width, len(names))]),
        tuple(field.strip("[]()") for field in rows[following]) if has_units else (),
        start,
        max(width, len(names)),
        sample,
    )
    return (float(min(tells[at], 1)), float(min(len(names), 2)), float(tells[at]), *shares), found


def _above_data(k: int, rows: Sequence[list[str]], data: Sequence[bool], width: int) -> bool:
    """Whether data follow on a line at once, or after one more."""
    below = [j for j in range(k + 1, len(rows)) if rows[j]][:2]
    return any(data[j] and abs(len(rows[j]) - width) <= 1 for j in below)


def _names(line: str, separator: str, quote: str) -> list[str]:
    """What a header names; one that is a remark by its first sign is one all the same."""
    names = split(line.lstrip("#%/ ") if is_comment(line) else line, separator, quote)
    while names and not names[-1]:
        names.pop()
    return names
