"""What goes wrong on a virtual device, as the command line names it: NAME=VALUE."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from softfuse.errors import SoftfuseError
from softfuse.hardware.virtual.board_clock import BoardClock
from softfuse.hardware.virtual.line_faults import LineFaults
from softfuse.hardware.virtual.sensor_faults import DeadSensor, SensorFaults
from softfuse.hardware.virtual.serving import Outages


@dataclass(frozen=True)
class Faults:
    """All faults of a device; drift_ppm: of the first board's clock, the second's is off the other way."""

    line: LineFaults = LineFaults()
    sensors: SensorFaults = SensorFaults()
    outages: Outages | None = None
    drift_ppm: float = 0.0


HELP = (
    "drop-bytes=P and flip-bits=P: probability for each byte and bit; lose-samples=P; unplug=S/T: the port "
    "is gone for S of every T seconds; power-cut=S/T: the same, and the board starts anew; clock-drift=PPM "
    "(the second board's the other way); silent=CHANNEL@S, stuck=CHANNEL@S: a sensor dies after S seconds."
)
"""What can be asked for."""


def parse_faults(asked: Sequence[str], channels: Sequence[str]) -> Faults:
    """The faults that NAME=VALUE texts ask for, on a device with these channels.

    Raises SoftfuseError for a fault, number or channel that there is not, HardwareError for one that cannot
    be.
    """
    faults = Faults()
    for text in asked:
        name, equals, value = text.partition("=")
        if not equals or name not in _FAULTS:
            raise SoftfuseError(f'--fault "{text}": there is no such fault; give {_listing()} with =VALUE')
        try:
            faults = _FAULTS[name](faults, value)
        except ValueError as error:
            # A HardwareError is one, and tells what is wrong with the number.
            raise SoftfuseError(f'--fault "{text}": {error}') from error
    for dead in faults.sensors.dead:
        if dead.channel not in channels:
            raise SoftfuseError(
                f'--fault: there is no channel "{dead.channel}"; there are {", ".join(channels)}'
            )
    return faults


def _listing() -> str:
    *first, last = _FAULTS
    return f"{', '.join(first)} or {last}"


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SoftfuseError(f'"{text}" is not a number')
    return number


def _drop(faults: Faults, value: str) -> Faults:
    return replace(faults, line=replace(faults.line, drop=_number(value)))


def _flip(faults: Faults, value: str) -> Faults:
    return replace(faults, line=replace(faults.line, flip=_number(value)))


def _lose(faults: Faults, value: str) -> Faults:
    return replace(faults, sensors=replace(faults.sensors, lost=_number(value)))


def _drift(faults: Faults, value: str) -> Faults:
    drift = _number(value)
    BoardClock(100.0, drift_ppm=drift)  # raises where it cannot be
    return replace(faults, drift_ppm=drift)


def _outages(faults: Faults, value: str, *, powers: bool) -> Faults:
    if faults.outages is not None:
        raise SoftfuseError("the port is taken away twice: give one of unplug and power-cut")
    for_s, slash, every_s = value.partition("/")
    if not slash:
        raise SoftfuseError("give how long and how often in seconds, such as 2/30")
    return replace(faults, outages=Outages(_number(for_s), _number(every_s), powers))


def _unplug(faults: Faults, value: str) -> Faults:
    return _outages(faults, value, powers=False)


def _cut_power(faults: Faults, value: str) -> Faults:
    return _outages(faults, value, powers=True)


def _die(faults: Faults, value: str, *, silent: bool) -> Faults:
    channel, at, seconds = value.rpartition("@")
    if not at:
        raise SoftfuseError("give a channel and when it dies, such as row3@20")
    dead = DeadSensor(channel, _number(seconds), silent)
    return replace(faults, sensors=replace(faults.sensors, dead=(*faults.sensors.dead, dead)))


def _silence(faults: Faults, value: str) -> Faults:
    return _die(faults, value, silent=True)


def _stick(faults: Faults, value: str) -> Faults:
    return _die(faults, value, silent=False)


_FAULTS: dict[str, Callable[[Faults, str], Faults]] = {
    "drop-bytes": _drop,
    "flip-bits": _flip,
    "lose-samples": _lose,
    "unplug": _unplug,
    "power-cut": _cut_power,
    "clock-drift": _drift,
    "silent": _silence,
    "stuck": _stick,
}
