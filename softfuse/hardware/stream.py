"""What flows in from devices: bytes with the time at which they were read, and what people should know.

Everything after this is a function of the chunks in the order in which they were read, so that a recording
of them, replayed, gives the same frames. Nothing later asks a clock.
"""

import time
from dataclasses import dataclass
from typing import Literal

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes as they were read from a source."""

    source: int
    """Which one, from 0."""
    host_s: float
    """The host's time at which they were read, in seconds since the epoch (`HostClock`)."""
    data: bytes


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that people should know: opened, lost, reopened, a gap, a full disk, a device's remark."""

    host_s: float
    """The host's time, in seconds since the epoch."""
    source: int | None
    """The source that it is about, from 0; None: all of it."""
    level: Level
    text: str
    """One remark, as it came: to be escaped before it reaches a terminal."""


class HostClock:
    """The host's time: seconds since the epoch of one reading of the calendar, carried on monotonically.

    It never jumps when the calendar is set; read twice it may give the same time.
    """

    def __init__(self) -> None:
        self._anchor_ns = time.time_ns() - time.monotonic_ns()

    def now_s(self) -> float:
        """Seconds since the epoch."""
        return (self._anchor_ns + time.monotonic_ns()) / 1_000_000_000
