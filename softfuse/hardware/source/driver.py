"""What the bytes of a source mean.

A driver is a function of the chunks that were fed to it: it asks no clock and does no I/O, so that the same
chunks give the same readings. What it wants to be sent, it hands out.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.hardware.stream import Level, Notice

MOST_REMARKS = 10
"""Notices in a second of the host's time: a board may print without end."""
LONGEST_REMARK = 500
"""Characters of a notice."""

NEAR_WRAP_US = 60e6
"""A counter that was so near to its end, and is so near to its beginning, has wrapped [µs]."""
_COUNTER = 2**32


@dataclass(frozen=True, eq=False, slots=True)
class Reading:
    """What a device read at one time, n channels."""

    device: int
    """Which of the devices of its source."""
    sequence: int | None
    """The number of the sample by the device, modulo 2^32; None where the device does not count."""
    device_time_us: int | None
    """The device's time [µs]; None where the device does not tell."""
    host_s: float
    """The host's time of the chunk with its last byte, in seconds since the epoch."""
    names: tuple[str, ...]
    """Of the channels, as the columns of a recording, each with its unit at the end."""
    values: Float[np.ndarray, " n"]
    """(n,) in the units of the names, NaN where not read."""


@dataclass
class CounterTime:
    """A device's time, carried on over the wraps of a counter of 32 bits; one that restarted begins anew."""

    microseconds: float = 1.0
    """Of each count; one of a second or more does not wrap."""
    last: float = 0.0
    wraps: int = 0

    def carried(self, raw: float) -> int:
        """The time [µs] that the counter's next value stands for."""
        near = NEAR_WRAP_US / self.microseconds
        if self.microseconds < 1e6 and _COUNTER - near < self.last < _COUNTER and raw < near:
            self.wraps += 1
        elif raw < self.last:
            self.wraps = 0
        self.last = raw
        return round((raw + self.wraps * _COUNTER) * self.microseconds)


class AbstractDriver(ABC):
    """The meaning of one source's bytes; of a device that sends by itself unless it says otherwise."""

    def __init__(self) -> None:
        self._notices: list[Notice] = []
        self._second = -1
        self._in_second = 0
        self._left_out = 0
        """Remarks that were too many."""

    @abstractmethod
    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        """The readings that end in the next bytes, which came at host_s [s]; in order.

        Nothing that the bytes are raises: what is no reading is counted. A source of datagrams feeds one at
        a time.
        """

    @abstractmethod
    def interrupted(self) -> None:
        """Forget what has begun: the line was cut."""

    @property
    @abstractmethod
    def counts(self) -> Mapping[str, int]:
        """What became of the bytes so far, by what people call it."""

    def greeting(self) -> tuple[bytes, ...]:
        """What is to be sent after opening and after a silence, with a pause after each part."""
        return ()

    def farewell(self) -> bytes:
        """What is to be sent before closing."""
        return b""

    def take_requests(self) -> bytes:
        """What the last chunks ask to be sent now; each is handed out once."""
        return b""

    def take_notices(self) -> list[Notice]:
        """What people should know of the last chunks, of source None; each is handed out once."""
        taken, self._notices = self._notices, []
        return taken

    def _remark(self, host_s: float, level: Level, text: str) -> None:
        """Note what people should know, of the host's time host_s [s]; what is too much is counted."""
        second = int(host_s)
        if second != self._second:
            self._second, self._in_second = second, 0
        self._in_second += 1
        if self._in_second > MOST_REMARKS:
            self._left_out += 1
            return
        cut = text if len(text) <= LONGEST_REMARK else text[:LONGEST_REMARK] + "…"
        self._notices.append(Notice(host_s, None, level, cut))
