"""Boards that print lines of numbers: time_us,v0,v1,... one line a sample.

For boards that print more than that, only the lines with a prefix may be taken, and only their first fields.
A line ends with \\n or \\r\\n and is one of

* a header: its fields name every column that is wanted; a # may stand before it, and the time need not be
  named in it, then it is the first column;
* a remark: it begins with #, or with a letter and has neither numbers nor as many fields as there are
  columns; handed on as text;
* data: as many fields as there are columns, and perhaps an empty one after the last separator. A field that
  is no finite number ("nan", "ERROR", nothing) is a reading that is missing (NaN, counted), in a column that
  nobody wants it does not matter; the time must be one, and without a time some field.

Everything else is malformed and counted, and so is a line longer than `LONGEST_LINE`.
There is no CRC: a digit that changes or goes missing within a field is not seen. Sequence numbers count the
lines of data, the malformed ones included, so that these show up as gaps.

The first line after the stream was opened or interrupted may have lost its beginning ("45,7" of "12345,7")
and is not believed unless it is a header. Times in µs or ms that were counted in 32 bits, as Arduino's
micros() and millis(), are carried on when the counter wraps.

What well-known example sketches print (read from their sources in 2026; values are counts, or pF where it
says so):

* `mpr121-bare-conductive`: Bare Conductive's library MPR121, example DataStream: among others a line
  "FDAT: " and 13 filtered values between spaces, of electrodes 0 to 11 and of proximity (e0 .. e12).
* `mpr121-adafruit`: Adafruit_MPR121, example MPR121test, with its line `return;` removed as the sketch says:
  a line "Filt: " and 12 filtered values, a tab after each (e0 .. e11).
* `fdc1004-single`: ProtoCentral_fdc1004_breakout, examples Example1-FDC-streaming and -single-channel:
  milliseconds, pF, CAPDAC and a status in words, between one or two tabs (time_ms, pF, capdac).
* `fdc1004-multi`: the same, Example2-multi-channel: seconds with one decimal, then four channels in pF and a
  status (pF0 .. pF3). Its time is too coarse to be used. A channel that reads ERROR is missing.
* `trill-craft`: Bela's Trill-Arduino, example craft-print: 30 values with leading zeros, a space after each,
  no time (c0 .. c29). The other Trill sensors print the same with other numbers of values: give `columns`.
* `muca`: muca-board's Muca, example Muca_Raw with `SendRawString()` in place of `SendRawByte()`: 21 x 12
  values between commas, no time (c0 .. c251). What `SendRawByte` sends, 254 bytes without a mark
  where they begin, cannot be told apart and is not read.

Most print no time and no sketch a number, so lines that go missing in them are not seen.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softfuse.errors import WireError
from softfuse.hardware.source.driver import AbstractDriver, CounterTime, Reading
from softfuse.hardware.table.form import number
from softfuse.hardware.wire.description import Channel, Description, RawType

LONGEST_LINE = 16384
"""Bytes of the longest line, without its end."""
SEPARATORS = (",", ";", "\t", " ", ":", "|")
_MICROSECONDS = {"_us": 1.0, "_ms": 1e3, "_s": 1e6}
_LATEST_US = 2.0**53


@dataclass(frozen=True)
class TextFormat:
    """What a board prints; WireError for columns that cannot be told apart."""

    columns: tuple[str, ...] = ()
    """All columns in order, the time's included; (): a header says them."""
    time: str | None = None
    """The column of the board's time, which ends in _us, _ms or _s; None: the time of arrival is taken."""
    separator: str = ","
    """Between the fields; spaces around them do not matter, and " " stands for any white space."""
    prefix: str = ""
    """Only lines that begin with it are read, without it."""
    first_fields: int | None = None
    """Only lines that begin with a number are read, and of them so many fields between white space."""

    def __post_init__(self) -> None:
        if self.time is not None and not self.time.endswith(tuple(_MICROSECONDS)):
            raise WireError(f"the time column {self.time!r} has no unit: end its name in _us, _ms or _s")
        if self.separator not in SEPARATORS:
            raise WireError(f"fields cannot be separated by {self.separator!r}: use one of {SEPARATORS!r}")

    @property
    def microseconds(self) -> float:
        """Microseconds per unit of the time column."""
        unit = "us" if self.time is None else self.time.rpartition("_")[2]
        return _MICROSECONDS["_" + unit]

    def split(self, line: str) -> list[str]:
        """The fields of a line."""
        parts = line.split() if self.separator == " " else line.split(self.separator)
        return [part.strip() for part in parts]


def _numbered(letter: str, count: int) -> tuple[str, ...]:
    return tuple(f"{letter}{k}" for k in range(count))


PRESETS: Mapping[str, TextFormat] = {
    "mpr121-bare-conductive": TextFormat(_numbered("e", 13), separator=" ", prefix="FDAT:"),
    "mpr121-adafruit": TextFormat(_numbered("e", 12), separator=" ", prefix="Filt:"),
    "fdc1004-single": TextFormat(("time_ms", "pF", "capdac"), time="time_ms", separator=" ", first_fields=3),
    "fdc1004-multi": TextFormat(("time_s", *_numbered("pF", 4)), separator=" ", first_fields=5),
    "trill-craft": TextFormat(_numbered("c", 30), separator=" "),
    "muca": TextFormat(_numbered("c", 252)),
}
"""What well-known example sketches print, by name."""


class TextLines(AbstractDriver):
    """One board that prints lines."""

    def __init__(self, form: TextFormat, channels: Mapping[str, str]) -> None:
        """channels: column of the lines -> name of the channel.

        WireError for columns that cannot be told apart or names that cannot be.
        """
        super().__init__()
        self._form, self._channels, self._names = form, channels, tuple(channels.values())
        # Refuses names that cannot be.
        Description("lines", tuple(Channel(name, RawType.F64, 1.0, 0.0) for name in self._names))
        self._wanted = (*channels, *(() if form.time is None else (form.time,)))
        for column in (*channels, *form.columns):
            if number(column, ".") is not None:
                raise WireError(f"a column cannot be named by the number {column!r}: give it a name")
        if form.columns and self._ordered(form.columns) is None:
            missing = [column for column in self._wanted if column not in form.columns]
            what = f"lack {missing[0]!r}" if missing else "name one twice"
            raise WireError(f"the columns {', '.join(form.columns)} {what}")
        self._columns = form.columns
        self._time = CounterTime(form.microseconds)
        self._partial = bytearray()
        self._too_long = self._whole = False
        self._sequence = 0
        # All lines but blank ones are in one of these, but for "missing readings" and the last two.
        self._counts = {
            "samples": 0,
            "malformed": 0,
            "missing readings": 0,
            "too long": 0,
            "before any header": 0,
            "without their beginning": 0,
            "headers": 0,
            "remarks": 0,
            "remarks left out": 0,
            "other lines": 0,
            "bytes discarded": 0,
        }

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        *ended, begun = data.split(b"\n")
        readings: list[Reading] = []
        for piece in ended:
            self._extend(piece)
            if self._too_long:
                self._too_long = False
            else:
                # Tabs may stand for fields that are empty.
                line = self._picked(bytes(self._partial).strip(b" \r"))
                self._partial.clear()
                if line.strip():
                    readings += self._line(line, host_s)
            self._whole = True
        self._extend(begun)
        return readings

    def interrupted(self) -> None:
        """Forget a line that has begun, and doubt the next."""
        self._counts["bytes discarded"] += len(self._partial)
        self._partial.clear()
        self._too_long = self._whole = False

    @property
    def counts(self) -> Mapping[str, int]:
        return self._counts | {"remarks left out": self._left_out}

    def _ordered(self, names: tuple[str, ...]) -> tuple[str, ...] | None:
        """The names if they are those of all columns, and each that is wanted is there once, else None; an
        empty one after the last separator is none.
        """
        names = names[:-1] if names and not names[-1] else names
        return names if all(names.count(column) == 1 for column in self._wanted) else None

    def _extend(self, piece: bytes) -> None:
        if self._too_long:
            self._counts["bytes discarded"] += len(piece)
        elif len(self._partial) + len(piece) > LONGEST_LINE:
            self._counts["too long"] += 1
            self._counts["bytes discarded"] += len(self._partial) + len(piece)
            self._partial.clear()
            self._too_long = True
            self._sequence = (self._sequence + 1) % 2**32
        else:
            self._partial += piece

    def _picked(self, line: bytes) -> bytes:
        """What is wanted of a line; nothing of the first after an interruption, which may be half a line."""
        prefix, fields = self._form.prefix.encode(), self._form.first_fields
        if not prefix and fields is None:
            return line
        rest = line.removeprefix(prefix).strip(b" ")
        # No beginning is lost of a line with the prefix; one of numbers may have lost some of the first.
        whole = line.startswith(prefix) and (self._whole or bool(prefix))
        if not whole or (fields is not None and not rest[:1].isdigit()):
            self._counts["other lines"] += bool(line if not whole else rest)
            return b""
        self._whole = True
        return rest if fields is None else b" ".join(rest.split()[:fields])

    def _line(self, line: bytes, host_s: float) -> list[Reading]:
        text = line.decode(errors="replace")
        names = self._form.split(text.lstrip("#").strip(" "))
        if not line.isascii():
            return self._data(names, host_s)
        header = self._header(text, tuple(names))
        if header is not None:
            self._columns = header
            self._counts["headers"] += 1
            return []
        if text.startswith("#") or self._prose(text, names):
            self._counts["remarks"] += 1
            self._remark(host_s, "info", text)
            return []
        return self._data(names, host_s)

    def _header(self, text: str, names: tuple[str, ...]) -> tuple[str, ...] | None:
        """All columns, if this line is a header."""
        header = self._ordered(names)
        if header is None and self._form.time is not None and text.startswith("#"):
            header = self._ordered((self._form.time, *names))
        return header

    def _prose(self, text: str, fields: list[str]) -> bool:
        """Whether a line without # is a remark all the same; readings that failed ("nan,nan") are none."""
        readings = len(fields) == len(self._columns)
        return text[0].isalpha() and not readings and all(number(one, ".") is None for one in fields)

    def _data(self, fields: list[str], host_s: float) -> list[Reading]:
        if not self._whole:
            self._counts["without their beginning"] += 1
            return []
        if not self._columns:
            self._counts["before any header"] += 1
            return []
        if len(fields) == len(self._columns) + 1 and not fields[-1]:
            fields = fields[:-1]
        numbers = [number(text, ".") for text in fields]
        if len(fields) != len(self._columns) or all(one is None for one in numbers):
            return self._refused()
        by_name = dict(zip(self._columns, numbers, strict=True))
        time_us = None
        if self._form.time is not None:
            raw = by_name[self._form.time]
            if raw is None or not 0.0 <= raw * self._form.microseconds < _LATEST_US:
                return self._refused()
            time_us = self._time.carried(raw)
        read = (by_name[column] for column in self._channels)
        values = np.array([math.nan if one is None else one for one in read])
        self._counts["missing readings"] += int(np.isnan(values).sum())
        self._counts["samples"] += 1
        sequence, self._sequence = self._sequence, (self._sequence + 1) % 2**32
        return [Reading(0, sequence, time_us, host_s, self._names, values)]

    def _refused(self) -> list[Reading]:
        """A line of data that cannot be read: counted, and missing in the sequence."""
        self._counts["malformed"] += 1
        self._sequence = (self._sequence + 1) % 2**32
        return []
