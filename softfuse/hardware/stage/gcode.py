"""A stage of three axes that is moved by G-code, with grbl or Marlin.

A move is checked against the workspace before anything is sent; then it is a straight line (G1), and the call
comes back when the stage is there and says so. The time that the move should take is waited for before the
firmware is told to answer when it is done, since some do not hear a stop while they owe that answer.

Whoever stops the stage does so from another thread. The stage's coordinates are its work coordinates (G54).
"""

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from time import monotonic

from softfuse.errors import HardwareError
from softfuse.hardware.source.connection import remedy
from softfuse.hardware.source.port import AbstractPort, open_serial
from softfuse.hardware.stage.dialect import PATIENCE_S, AbstractDialect, Halted, Millimetres, Talk
from softfuse.hardware.stage.grbl import Grbl
from softfuse.hardware.stage.marlin import Marlin

Place = tuple[float, float, float]
"""x, y, z [m], in the stage's coordinates."""
_AXES = "xyz"

TOLERANCE = 0.02e-3
"""How far from its target a stage may stop [m]; firmwares round to a step."""
GREETING_S = 10.0
"""How long a board may take to start [s]."""
HELLO_AGAIN_S = 1.0
HOMING_S = 120.0


@dataclass(frozen=True)
class Workspace:
    """A box and a greatest speed; HardwareError where they are none.

    A straight move between two points of the box stays in it; one from outside, after homing, comes in. A
    stage that stands at the box's edge, as exactly as stages do, may retreat along it.
    """

    lowest: Place
    highest: Place
    fastest: float
    """[m/s]"""

    def __post_init__(self) -> None:
        for axis, low, high in zip(_AXES, self.lowest, self.highest, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise HardwareError(
                    f"the stage's {axis} cannot lie between {_mm(low)} and {_mm(high)}: "
                    "give the lowest first, then the highest"
                )
        if not (math.isfinite(self.fastest) and self.fastest > 0.0):
            raise HardwareError(f"the stage's greatest speed cannot be {_mm(self.fastest)}/s")

    def check(self, place: Place, speed: float) -> None:
        """HardwareError unless the stage may go to the place [m] with the speed [m/s]."""
        for axis, value, low, high in zip(_AXES, place, self.lowest, self.highest, strict=True):
            if not low - TOLERANCE <= value <= high + TOLERANCE:
                raise HardwareError(
                    f"the stage must not go to {axis} = {_mm(value)}: {axis} lies between {_mm(low)} and "
                    f"{_mm(high)}; nothing has moved"
                )
        if not 0.0 < speed <= self.fastest:
            raise HardwareError(
                f"the stage must not go with {_mm(speed)}/s: up to {_mm(self.fastest)}/s; nothing has moved"
            )


def _mm(length: float) -> str:
    return f"{1e3 * length:g} mm"


class GcodeStage:
    """One stage; `connect` first, `close` last."""

    def __init__(self, port: AbstractPort, dialect: AbstractDialect, workspace: Workspace) -> None:
        self._port = port
        self._dialect = dialect
        self._workspace = workspace
        self._talk = Talk(port, dialect)
        self._busy = threading.Lock()
        self._set_up = False
        self._homing = False

    def connect(self) -> None:
        """Wait until the firmware greets; HardwareError where it does not within 10 s."""
        with self._turn():
            self._greet()

    def home(self) -> None:
        """Seek the end switches, after which the position is known again.

        HardwareError where that fails, also for a stage without switches, or is stopped.
        """
        with self._turn():
            if self._talk.trouble is not None:
                self._greet()
            self._set_up = False
            self._homing = True
            self._talk.command(self._dialect.home, patience_s=HOMING_S)
            self._talk.place = None

    def move_to(self, x: float, y: float, z: float, *, speed: float) -> Place:
        """Move straight to x, y, z [m] with a speed [m/s], and back when the stage stands: where [m].

        HardwareError, before anything moves, where the workspace does not allow it or the stage has given
        up before; later where it gives up, is stopped, or has not got there.
        """
        self._workspace.check((x, y, z), speed)
        target = (1e3 * x, 1e3 * y, 1e3 * z)
        with self._turn():
            self._talk.check()
            if not self._set_up:
                for command in self._dialect.setup:
                    self._talk.command(command)
                self._set_up = True
            here = self._talk.place or self._dialect.locate(self._talk)
            axes = " ".join(f"{axis}{value:.4f}" for axis, value in zip("XYZ", target, strict=True))
            self._talk.command(f"G1 {axes} F{60e3 * speed:.3f}")
            seconds = 1e-3 * math.dist(here, target) / speed
            self._talk.wait(seconds)
            self._talk.command(self._dialect.settle, patience_s=PATIENCE_S + seconds)
            there = self._dialect.locate(self._talk)
            if math.dist(there, target) > 1e3 * TOLERANCE:
                raise HardwareError(
                    f"the stage stands at {_shown(there)} instead of {_shown(target)}: "
                    "check its limits and its settings for the steps"
                )
        return _metres(there)

    def position(self) -> Place:
        """Where the stage is [m]; HardwareError where it does not say so."""
        with self._turn():
            return _metres(self._dialect.locate(self._talk))

    def stop(self) -> None:
        """Stop at once, from any thread; back when the stage stands.

        A move under way ends with a HardwareError; the next one is taken again. A stage that was seeking its
        end switches has to seek them again.
        """
        self._talk.halt(self._dialect.abort if self._homing else self._dialect.halt)
        with self._busy:
            if self._talk.halted:
                self._recover()

    def close(self) -> None:
        """Close the port, when no move is under way; the stage stays where it is."""
        with self._busy:
            self._port.close()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """One command at a time; after a halt the stage is made to take moves again."""
        with self._busy:
            try:
                yield
            except Halted:
                self._recover()
                self._talk.check()
                place = self._dialect.locate(self._talk)
                raise HardwareError(f"the stage was stopped at {_shown(place)}") from None
            except HardwareError:
                # What is wrong may be the halt, as an alarm tells it.
                if self._talk.halted:
                    self._recover()
                raise
            finally:
                self._homing = False

    def _recover(self) -> None:
        self._set_up = False
        try:
            self._dialect.recover(self._talk)
            if self._homing:
                self._talk.trouble = "it was stopped while it sought its end switches: home it"
        except HardwareError as error:
            self._talk.trouble = str(error)
            raise
        finally:
            self._talk.resume()
            self._talk.place = None

    def _greet(self) -> None:
        end = monotonic() + GREETING_S
        self._set_up = False
        while monotonic() < end:
            self._talk.send(self._dialect.hello)
            pause = monotonic() + HELLO_AGAIN_S
            while monotonic() < pause:
                if any(heard.greeting for heard in self._talk.lines()):
                    # Answers to a hello before, and remarks.
                    self._talk.drain()
                    self._talk.trouble = None
                    self._talk.place = None
                    return
        raise HardwareError(
            f"no {self._dialect.name} answers for {GREETING_S:g} s: check the port, its baud rate (115200 "
            "for most), and which firmware the stage has"
        )


def _metres(place: Millimetres) -> Place:
    x, y, z = place
    return 1e-3 * x, 1e-3 * y, 1e-3 * z


def _shown(place: Millimetres) -> str:
    return f"({', '.join(f'{value:.3f}' for value in place)}) mm"


class Firmware(StrEnum):
    """What a stage is controlled by."""

    GRBL = "grbl"
    MARLIN = "marlin"


def open_stage(url: str, baud: int, firmware: Firmware, workspace: Workspace) -> GcodeStage:
    """The stage at a port, to be connected, which may go where the workspace allows; HardwareError where the
    port cannot be opened.
    """
    try:
        port = open_serial(url, baud)
    except OSError as error:
        raise HardwareError(remedy(url, error)) from error
    return GcodeStage(port, Grbl() if firmware is Firmware.GRBL else Marlin(), workspace)
