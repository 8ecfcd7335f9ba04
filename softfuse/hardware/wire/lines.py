"""Lines of text, for boards that print numbers: time_us,v0,v1,... one line a sample.

A line ends with \\n or \\r\\n and is one of

* a header: its fields name every column that is wanted; a # may stand before it, and the time need not be
  named in it, then it is the first column;
* a remark: it begins with #, or with a letter and has neither numbers nor as many fields as there are
  columns; handed on as text;
* data: as many fields as there are columns, and perhaps an empty one after the last separator. A field that
  is no finite number ("nan", "ERROR", nothing) is a reading that is missing (NaN, counted), in a column that
  nobody wants it does not matter; the time must be one, and without a time some field.

Everything else is malformed and counted, and so is a line longer than `LONGEST_LINE`.
There is no CRC: a digit that changes or goes missing within a field is not seen. What comes out is what a
device of the binary protocol sends: a description (64 bit floats, scale 1, offset 0), then samples. Their
sequence numbers count the lines of data, the malformed ones included, so that these show up as gaps.

The first line after the stream was opened or interrupted may have lost its beginning ("45,7" of "12345,7")
and is not believed unless it is a header. Times in µs or ms that were counted in 32 bits, as Arduino's
micros() and millis(), are carried on when the counter wraps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from softfuse.errors import WireError
from softfuse.hardware.wire.channel import Channel, RawType
from softfuse.hardware.wire.decoder import Received
from softfuse.hardware.wire.description import Description
from softfuse.hardware.wire.layout import Layout
from softfuse.hardware.wire.message import DescriptionMessage, Header, SampleMessage, TextMessage

LONGEST_LINE = 16384
"""Bytes of the longest line, without its end."""
SEPARATORS = (",", ";", "\t", " ", ":", "|")
_MICROSECONDS = {"_us": 1.0, "_ms": 1e3, "_s": 1e6}
_COUNTER = 2.0**32
_NEAR_WRAP_US = 60e6
_LATEST_US = 2.0**53


@dataclass(frozen=True)
class LineFormat:
    """What the columns of the lines are; WireError for columns that cannot be told apart."""

    channels: Mapping[str, str]
    """Column of the lines -> name of the channel; in the order of the channels."""
    columns: tuple[str, ...] = ()
    """All columns in order, the time's included, of a board that sends no header."""
    time: str | None = "time_us"
    """The column of the board's time, which ends in _us, _ms or _s; None: the time of arrival is taken."""
    separator: str = ","
    """Between the fields; spaces around them do not matter, and " " stands for any white space."""

    def __post_init__(self) -> None:
        if self.time is not None and not self.time.endswith(tuple(_MICROSECONDS)):
            raise WireError(f"the time column {self.time!r} has no unit: end its name in _us, _ms or _s")
        if self.separator not in SEPARATORS:
            raise WireError(f"fields cannot be separated by {self.separator!r}: use one of {SEPARATORS!r}")
        for column in (*self.channels, *self.columns):
            if _number(column) is not None:
                raise WireError(f"a column cannot be named by the number {column!r}: give it a name")
        if self.columns and self.order(self.columns) is None:
            missing = [column for column in self._wanted if column not in self.columns]
            what = f"lack {missing[0]!r}" if missing else "name one twice"
            raise WireError(f"the columns {', '.join(self.columns)} {what}")

    @property
    def _wanted(self) -> tuple[str, ...]:
        return (*self.channels, *(() if self.time is None else (self.time,)))

    @property
    def microseconds(self) -> float:
        """Microseconds per unit of the time column."""
        unit = "us" if self.time is None else self.time.rpartition("_")[2]
        return _MICROSECONDS["_" + unit]

    def order(self, names: tuple[str, ...]) -> tuple[str, ...] | None:
        """The names if they are those of all columns, and each that is wanted is there once, else None; an
        empty one after the last separator is none.
        """
        names = names[:-1] if names and not names[-1] else names
        return names if all(names.count(column) == 1 for column in self._wanted) else None

    def split(self, line: str) -> list[str]:
        """The fields of a line."""
        parts = line.split() if self.separator == " " else line.split(self.separator)
        return [part.strip() for part in parts]


@dataclass(frozen=True)
class LineCounts:
    """What became of the lines: all but blank ones are in one of these."""

    samples: int
    headers: int
    remarks: int
    malformed: int
    """Lines of data whose time or none of whose fields can be read, or with another number of them."""
    oversized: int
    undescribed: int
    """Lines of data before any header."""
    partial: int
    """First lines that may have lost their beginning."""
    bytes_discarded: int
    """Bytes of the oversized lines and of `discard_partial`, without the line's end."""


@dataclass
class _Tally:
    samples: int = 0
    headers: int = 0
    remarks: int = 0
    malformed: int = 0
    oversized: int = 0
    undescribed: int = 0
    partial: int = 0
    bytes_discarded: int = 0


@dataclass
class _Time:
    """The board's time, carried on over the wraps of a 32 bit counter."""

    microseconds: float
    last: float = 0.0
    wraps: int = 0

    def carried(self, raw: float) -> int:
        near = _NEAR_WRAP_US / self.microseconds
        if self.microseconds < 1e6 and _COUNTER - near < self.last < _COUNTER and raw < near:
            self.wraps += 1
        elif raw < self.last:
            self.wraps = 0
        self.last = raw
        return round((raw + self.wraps * _COUNTER) * self.microseconds)


@dataclass
class LineDecoder:
    """The samples of one board that prints lines."""

    format: LineFormat
    name: str = "lines"
    """Of the device."""
    device: int = 0
    """Its number."""
    _count: _Tally = field(default_factory=_Tally, init=False)
    _partial: bytearray = field(default_factory=bytearray, init=False)
    _too_long: bool = field(default=False, init=False)
    _whole: bool = field(default=False, init=False)
    _announced: bool = field(default=False, init=False)
    _sequence: int = field(default=0, init=False)
    missing: int = field(default=0, init=False)
    """Readings in samples that are no finite numbers."""

    def __post_init__(self) -> None:
        self._columns = self.format.columns
        self._time = _Time(self.format.microseconds)
        channels = [Channel(name, RawType.F64, 1.0, 0.0) for name in self.format.channels.values()]
        self._layout = Layout(Description(self.name, tuple(channels)))

    @property
    def counts(self) -> LineCounts:
        """What has become of the lines so far."""
        return LineCounts(**vars(self._count))

    def feed(self, data: bytes, host_s: float) -> list[Received]:
        """The messages of the lines that end in the next bytes, which came at host_s [s]; in order.

        Nothing that the bytes are raises.
        """
        *ended, begun = data.split(b"\n")
        received: list[Received] = []
        for piece in ended:
            self._extend(piece)
            if self._too_long:
                self._too_long = False
            else:
                # Tabs may stand for fields that are empty.
                line = bytes(self._partial).strip(b" \r")
                self._partial.clear()
                if line.strip():
                    received += self._line(line, host_s)
            self._whole = True
        self._extend(begun)
        return received

    def discard_partial(self) -> None:
        """Forget a line that has begun, and doubt the next, since the stream was interrupted."""
        self._count.bytes_discarded += len(self._partial)
        self._partial.clear()
        self._too_long = self._whole = False

    def _extend(self, piece: bytes) -> None:
        if self._too_long:
            self._count.bytes_discarded += len(piece)
        elif len(self._partial) + len(piece) > LONGEST_LINE:
            self._count.oversized += 1
            self._count.bytes_discarded += len(self._partial) + len(piece)
            self._partial.clear()
            self._too_long = True
            self._sequence = (self._sequence + 1) % 2**32
        else:
            self._partial += piece

    def _line(self, line: bytes, host_s: float) -> list[Received]:
        text = line.decode(errors="replace")
        names = self.format.split(text.lstrip("#").strip(" "))
        if not line.isascii():
            return self._data(names, host_s)
        header = self._header(text, tuple(names))
        if header is not None:
            self._columns = header
            self._count.headers += 1
            return [self._description(host_s)]
        if text.startswith("#") or self._prose(text, names):
            self._count.remarks += 1
            return [Received(host_s, TextMessage(self._stamp(0), text), None)]
        return self._data(names, host_s)

    def _header(self, text: str, names: tuple[str, ...]) -> tuple[str, ...] | None:
        """All columns, if this line is a header."""
        header = self.format.order(names)
        if header is None and self.format.time is not None and text.startswith("#"):
            header = self.format.order((self.format.time, *names))
        return header

    def _prose(self, text: str, fields: list[str]) -> bool:
        """Whether a line without # is a remark all the same; readings that failed ("nan,nan") are none."""
        readings = len(fields) == len(self._columns)
        return text[0].isalpha() and not readings and all(_number(one) is None for one in fields)

    def _data(self, fields: list[str], host_s: float) -> list[Received]:
        if not self._whole:
            self._count.partial += 1
            return []
        if not self._columns:
            self._count.undescribed += 1
            return []
        if len(fields) == len(self._columns) + 1 and not fields[-1]:
            fields = fields[:-1]
        numbers = [_number(text) for text in fields]
        if len(fields) != len(self._columns) or all(number is None for number in numbers):
            return self._refused(host_s)
        by_name = dict(zip(self._columns, numbers, strict=True))
        raw = host_s * 1e6 if self.format.time is None else by_name[self.format.time]
        if raw is None or not 0.0 <= raw * self.format.microseconds < _LATEST_US:
            return self._refused(host_s)
        time_us = round(raw) if self.format.time is None else self._time.carried(raw)
        read = (by_name[column] for column in self.format.channels)
        values = np.array([math.nan if number is None else number for number in read])
        self.missing += int(np.isnan(values).sum())
        message = SampleMessage(self._stamp(time_us), self._layout.number, self._layout.content(values))
        self._count.samples += 1
        self._sequence = (self._sequence + 1) % 2**32
        described = [] if self._announced else [self._description(host_s)]
        return [*described, Received(host_s, message, values)]

    def _refused(self, host_s: float) -> list[Received]:
        """A line of data that cannot be read: counted, and missing in the sequence."""
        if self._whole:
            self._count.malformed += 1
            self._sequence = (self._sequence + 1) % 2**32
        else:
            self._count.partial += 1
        return []

    def _description(self, host_s: float) -> Received:
        self._announced = True
        return Received(host_s, DescriptionMessage(self._stamp(0), self._layout.description), None)

    def _stamp(self, time_us: int) -> Header:
        return Header(self.device, self._sequence, time_us)


def _number(text: str) -> float | None:
    """The finite number that a text is, or None; Python's own 1_000 is none."""
    if "_" in text:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
