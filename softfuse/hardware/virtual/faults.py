"""What goes wrong on a virtual device, and how the command line names it: NAME=VALUE.

On the line bytes are dropped and bits are flipped, each independently of all others. Ports go away for a
while. What goes wrong before a sample is packed is the board's (`board`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softfuse.errors import HardwareError, SoftfuseError
from softfuse.hardware.virtual.board import BoardClock, DeadSensor, SensorFaults

_NAMES = ("drop-bytes", "flip-bits", "lose-samples", "unplug", "power-cut", "clock-drift", "silent", "stuck")
HELP = (
    "drop-bytes=P and flip-bits=P: probability for each byte and bit; lose-samples=P; unplug=S/T: the port "
    "is gone for S of every T seconds; power-cut=S/T: the same, and the board starts anew; clock-drift=PPM "
    "(the second board's the other way); silent=CHANNEL@S, stuck=CHANNEL@S: a sensor dies after S seconds."
)
"""What can be asked for."""


@dataclass(frozen=True)
class LineFaults:
    """Probability that a byte is dropped, and that a bit is flipped."""

    drop: float = 0.0
    flip: float = 0.0

    def __post_init__(self) -> None:
        for share, what in ((self.drop, "byte is dropped"), (self.flip, "bit is flipped")):
            if not 0.0 <= share <= 0.5:
                raise HardwareError(f"the probability {share:g} that a {what} must be between 0 and 0.5")


class FaultyLine:
    """Spoils the bytes of one line; the same seed spoils the same bytes."""

    def __init__(self, faults: LineFaults, seed: Sequence[int]) -> None:
        self._faults = faults
        self._rng = np.random.default_rng(np.random.SeedSequence(list(seed)))
        self.dropped = 0
        """Bytes that were dropped so far."""
        self.flipped = 0
        """Bits that were flipped so far, those of bytes that were dropped included."""

    def carry(self, data: bytes) -> bytes:
        """What comes out at the other end."""
        if self._faults.flip > 0.0:
            data = self._flip(data)
        if self._faults.drop > 0.0:
            data = self._drop(data)
        return data

    def _flip(self, data: bytes) -> bytes:
        bits = 8 * len(data)
        count = int(self._rng.binomial(bits, self._faults.flip))
        if count == 0:
            return data
        self.flipped += count
        spoiled = bytearray(data)
        for bit in self._rng.choice(bits, count, replace=False).tolist():
            spoiled[bit >> 3] ^= 1 << (bit & 7)
        return bytes(spoiled)

    def _drop(self, data: bytes) -> bytes:
        count = int(self._rng.binomial(len(data), self._faults.drop))
        if count == 0:
            return data
        self.dropped += count
        kept = np.ones(len(data), bool)
        kept[self._rng.choice(len(data), count, replace=False)] = False
        return np.frombuffer(data, np.uint8)[kept].tobytes()


@dataclass(frozen=True)
class Outages:
    """Ports go away for `for_s` at the end of every `every_s`, counted from the start.

    A line that is unplugged leaves the board running; one that also `powers` it starts the board anew.
    """

    for_s: float
    every_s: float
    powers: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.for_s < self.every_s:
            raise HardwareError(
                f"away for {self.for_s:g} s every {self.every_s:g} s: the first must be positive and less"
            )

    def out(self, elapsed_s: float) -> bool:
        """Whether the ports are away at a time [s] since the start."""
        return elapsed_s % self.every_s >= self.every_s - self.for_s


@dataclass(frozen=True)
class Faults:
    """All faults of a device; drift_ppm: of the first board's clock, the second's is off the other way."""

    line: LineFaults = LineFaults()
    sensors: SensorFaults = SensorFaults()
    outages: Outages | None = None
    drift_ppm: float = 0.0


def parse_faults(asked: Sequence[str], channels: Sequence[str]) -> Faults:
    """The faults that NAME=VALUE texts ask for, on a device with these channels.

    Raises SoftfuseError for a fault, number or channel that there is not, HardwareError for one that cannot
    be.
    """
    faults = Faults()
    for text in asked:
        name, equals, value = text.partition("=")
        if not equals or name not in _NAMES:
            *first, last = _NAMES
            listing = f"{', '.join(first)} or {last}"
            raise SoftfuseError(f'--fault "{text}": there is no such fault; give {listing} with =VALUE')
        try:
            faults = _with(faults, name, value)
        except ValueError as error:
            # A HardwareError is one, and tells what is wrong with the number.
            raise SoftfuseError(f'--fault "{text}": {error}') from error
    for dead in faults.sensors.dead:
        if dead.channel not in channels:
            raise SoftfuseError(
                f'--fault: there is no channel "{dead.channel}"; there are {", ".join(channels)}'
            )
    return faults


def _with(faults: Faults, name: str, value: str) -> Faults:
    """The faults with one more; ValueError for a value that cannot be."""
    match name:
        case "drop-bytes":
            return replace(faults, line=replace(faults.line, drop=_number(value)))
        case "flip-bits":
            return replace(faults, line=replace(faults.line, flip=_number(value)))
        case "lose-samples":
            return replace(faults, sensors=replace(faults.sensors, lost=_number(value)))
        case "clock-drift":
            drift = _number(value)
            BoardClock(100.0, drift_ppm=drift)  # raises where it cannot be
            return replace(faults, drift_ppm=drift)
        case "unplug" | "power-cut":
            if faults.outages is not None:
                raise SoftfuseError("the port is taken away twice: give one of unplug and power-cut")
            for_s, slash, every_s = value.partition("/")
            if not slash:
                raise SoftfuseError("give how long and how often in seconds, such as 2/30")
            return replace(faults, outages=Outages(_number(for_s), _number(every_s), name == "power-cut"))
        case _:
            channel, at, seconds = value.rpartition("@")
            if not at:
                raise SoftfuseError("give a channel and when it dies, such as row3@20")
            dead = DeadSensor(channel, _number(seconds), name == "silent")
            return replace(faults, sensors=replace(faults.sensors, dead=(*faults.sensors.dead, dead)))


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SoftfuseError(f'"{text}" is not a number')
    return number
