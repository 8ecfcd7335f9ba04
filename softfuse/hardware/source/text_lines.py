"""Boards that print lines of numbers, by a map from the lines' columns to channels.

A line is data as softfuse/hardware/wire/lines.py says. For boards that print more than that, only the lines
with a prefix may be taken, and only their first fields. What well-known example sketches print (read from
their sources in 2026; values are counts, or pF where it says so):

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

from collections.abc import Mapping
from dataclasses import dataclass

from softfuse.hardware.source.driver import AbstractDriver
from softfuse.hardware.source.reading import Reading
from softfuse.hardware.source.remarks import Remarks
from softfuse.hardware.stream import Notice
from softfuse.hardware.wire.lines import LONGEST_LINE, LineDecoder, LineFormat
from softfuse.hardware.wire.message import SampleMessage, TextMessage


@dataclass(frozen=True)
class TextFormat:
    """What a board prints."""

    columns: tuple[str, ...] = ()
    """All columns in order, the time's included; (): a header says them."""
    time: str | None = None
    """The column of the board's time, which ends in _us, _ms or _s; None: the time of arrival is taken."""
    separator: str = ","
    """Between the fields; " " stands for any white space."""
    prefix: str = ""
    """Only lines that begin with it are read, without it."""
    first_fields: int | None = None
    """Only lines that begin with a number are read, and of them so many fields between white space."""


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
        line_format = LineFormat(channels, form.columns, form.time, form.separator)
        self._decoder = LineDecoder(line_format)
        self._picker = _Picker(form) if form.prefix or form.first_fields else None
        self._names = tuple(channels.values())
        self._timed = form.time is not None
        self._remarks = Remarks()

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        """The readings that end in the next bytes, which came at host_s [s]; in order."""
        if self._picker is not None:
            data = self._picker.pick(data)
        readings = []
        for received in self._decoder.feed(data, host_s):
            header = received.message.header
            if isinstance(received.message, TextMessage):
                self._remarks.add(host_s, "info", received.message.text)
            elif isinstance(received.message, SampleMessage) and received.values is not None:
                time_us = header.time_us if self._timed else None
                readings.append(Reading(0, header.sequence, time_us, host_s, self._names, received.values))
        return readings

    def interrupted(self) -> None:
        """Forget a line that has begun, and doubt the next."""
        if self._picker is not None:
            self._picker.interrupted()
        self._decoder.discard_partial()

    @property
    def counts(self) -> Mapping[str, int]:
        """What became of the lines."""
        counts = self._decoder.counts
        skipped = 0 if self._picker is None else self._picker.skipped
        return {
            "samples": counts.samples,
            "malformed": counts.malformed,
            "missing readings": self._decoder.missing,
            "too long": counts.oversized,
            "before any header": counts.undescribed,
            "without their beginning": counts.partial,
            "headers": counts.headers,
            "remarks": counts.remarks,
            "remarks left out": self._remarks.left_out,
            "other lines": skipped,
            "bytes discarded": counts.bytes_discarded,
        }

    def greeting(self) -> tuple[bytes, ...]:
        """Nothing: such boards print whether somebody listens or not."""
        return ()

    def farewell(self) -> bytes:
        """Nothing."""
        return b""

    def take_requests(self) -> bytes:
        """Nothing."""
        return b""

    def take_notices(self) -> list[Notice]:
        """The board's remarks."""
        return self._remarks.take()


class _Picker:
    """Takes the wanted lines out of all, and the wanted fields out of them."""

    def __init__(self, form: TextFormat) -> None:
        self._prefix = form.prefix.encode()
        self._fields = form.first_fields
        self._partial = b""
        self._whole = False
        self.skipped = 0
        """Lines that are not wanted, the first after an interruption included, which may be half a line."""

    def pick(self, data: bytes) -> bytes:
        """The wanted lines that end in the next bytes."""
        *ended, begun = (self._partial + data).split(b"\n")
        # The rest of a line that is too long for any is the decoder's to refuse, by what is left of it.
        self._partial = begun[: LONGEST_LINE + 1]
        return b"".join(self._wanted(line.strip(b" \r")) for line in ended)

    def interrupted(self) -> None:
        """Forget a line that has begun."""
        self._partial = b""
        self._whole = False

    def _wanted(self, line: bytes) -> bytes:
        whole, self._whole = self._whole, True
        # No beginning is lost of a line with the prefix; one of numbers may have lost some of the first.
        if not line.startswith(self._prefix) or not (whole or self._prefix):
            self.skipped += bool(line)
            return b""
        rest = line[len(self._prefix) :].strip(b" ")
        if self._fields is not None:
            if not rest[:1].isdigit():
                self.skipped += bool(rest)
                return b""
            rest = b" ".join(rest.split()[: self._fields])
        # The empty line before it tells the decoder that this one begins here.
        return b"\n" + rest + b"\n"
