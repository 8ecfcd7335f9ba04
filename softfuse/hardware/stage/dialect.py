"""How a firmware for G-code wants to be spoken to, and the talk with it, line by line."""

import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from time import monotonic

from softfuse.errors import HardwareError
from softfuse.hardware.source.port import AbstractPort

PATIENCE_S = 5.0
"""How long the firmware may say nothing while it owes an answer [s]."""
PULSE_S = 0.5
"""How often it is asked for a sign of life meanwhile [s]."""
QUIET_S = 0.2
"""A silence after which no answer is under way any more [s]."""
LONGEST_LINE = 1024

Millimetres = tuple[float, float, float]


class Halted(Exception):
    """Somebody has stopped the stage."""


@dataclass(frozen=True)
class Heard:
    """What a line of the firmware says."""

    greeting: bool = False
    """That the firmware listens."""
    answer: bool = False
    """That a command was taken."""
    refusal: str | None = None
    """Why a command was not taken."""
    trouble: str | None = None
    """What has happened and what to do, since the stage has given up."""
    place: Millimetres | None = None
    """Where it is [mm], in the coordinates that moves are given in; None where the line does not tell."""
    state: str = ""
    """What it does, in the firmware's word; "" where the line does not tell."""


class AbstractDialect(ABC):
    """One firmware's language."""

    name: str
    """Of the firmware, for people."""
    hello: bytes
    """Makes it greet; may be sent again."""
    setup: tuple[str, ...]
    """Commands before the first move: millimetres, absolute positions."""
    home: str
    """Seeks the end switches."""
    settle: str
    """Is answered when all moves are done."""
    pulse: bytes
    """Asks for a sign of life while a command is carried out; empty where it gives one by itself."""
    halt: bytes
    """Stops a move at once and keeps the position."""
    abort: bytes
    """Stops the seeking of the end switches at once."""

    @abstractmethod
    def heard(self, line: str) -> Heard:
        """What a line says; a dialect may remember it."""

    @abstractmethod
    def working(self, state: str) -> bool:
        """Whether a stage in this state, as it last said, may still be carrying out a command."""

    @abstractmethod
    def locate(self, talk: "Talk") -> Millimetres:
        """Ask where the stage is."""

    @abstractmethod
    def recover(self, talk: "Talk") -> None:
        """After a halt: wait until it stands, and make it take moves again."""


class Talk:
    """The lines to and from a firmware, by one thread; only `halt` is for others."""

    def __init__(self, port: AbstractPort, dialect: AbstractDialect) -> None:
        self._port = port
        self._dialect = dialect
        self._partial = b""
        self._writing = threading.Lock()
        self._halted = threading.Event()
        self.place: Millimetres | None = None
        """Where the stage last was [mm]; None where nobody knows."""
        self.state = ""
        """What it last said that it does."""
        self.trouble: str | None = None
        """What is wrong with it, until it greets again."""

    def halt(self, data: bytes) -> None:
        """Stop whatever is under way with these bytes; from now on nothing else is sent, until `resume`."""
        with self._writing:
            self._halted.set()
            self._write(data)

    @property
    def halted(self) -> bool:
        """Whether somebody has stopped it."""
        return self._halted.is_set()

    def resume(self) -> None:
        """The halt is dealt with."""
        self._halted.clear()

    def send(self, data: bytes) -> None:
        """Send bytes; Halted where somebody has stopped it."""
        with self._writing:
            if self._halted.is_set():
                raise Halted
            self._write(data)

    def send_halted(self, data: bytes) -> None:
        """Send bytes to a stage that was stopped."""
        with self._writing:
            self._write(data)

    def command(self, text: str, *, patience_s: float = PATIENCE_S) -> None:
        """Send a line and wait for its answer.

        HardwareError where it is refused, where the stage gives up, or says nothing for patience_s [s];
        Halted where somebody stops it.
        """
        self.check()
        self.state = ""
        self.send(text.encode("ascii") + b"\n")
        deadline = monotonic() + patience_s
        pulse = monotonic() + PULSE_S
        while True:
            for heard in self._trusted_lines():
                if self._dialect.working(self.state):
                    deadline = monotonic() + patience_s
                if heard.answer:
                    # Some answer what was stopped as if it had been done.
                    if self._halted.is_set():
                        raise Halted
                    return
                if heard.refusal is not None:
                    self.drain()
                    raise HardwareError(f"the stage did not take {text!r}: {heard.refusal}")
            if self._halted.is_set():
                raise Halted
            if monotonic() > pulse and self._dialect.pulse:
                self.send(self._dialect.pulse)
                pulse = monotonic() + PULSE_S
            if monotonic() > deadline:
                state = f" and says {self.state!r}" if self.state else ""
                raise HardwareError(
                    f"the stage does not answer {text!r} for {patience_s:g} s{state}: is it held, or off?"
                )

    def wait(self, seconds: float) -> None:
        """Listen for so long; HardwareError where the stage gives up, Halted where somebody stops it."""
        end = monotonic() + seconds
        while monotonic() < end:
            self._trusted_lines()
            if self._halted.is_set():
                raise Halted

    def check(self) -> None:
        """HardwareError where the stage has given up since it greeted."""
        if self.trouble is not None:
            raise HardwareError(f"the stage has stopped: {self.trouble}")

    def drain(self) -> None:
        """Listen until nothing has come for QUIET_S, at most PATIENCE_S."""
        end = monotonic() + PATIENCE_S
        quiet = monotonic() + QUIET_S
        while monotonic() < min(quiet, end):
            if self.lines():
                quiet = monotonic() + QUIET_S

    def lines(self) -> list[Heard]:
        """What the lines say that have come, at once, or none after a moment; what they tell of the stage is
        kept.

        HardwareError where the port is gone.
        """
        try:
            data = self._port.read()
        except OSError as error:
            raise HardwareError(f"the stage's port went away: {error}") from error
        *ended, begun = (self._partial + data).split(b"\n")
        self._partial = begun[:LONGEST_LINE]
        lines = (line[:LONGEST_LINE].decode("ascii", "replace").strip() for line in ended)
        found = [self._dialect.heard(line) for line in lines if line]
        for heard in found:
            self.place = heard.place or self.place
            self.state = heard.state or self.state
            if heard.trouble is not None:
                self.trouble, self.place = heard.trouble, None
        return found

    def _trusted_lines(self) -> list[Heard]:
        """What the lines say that have come; HardwareError where one says that the stage has given up."""
        lines = self.lines()
        if any(heard.greeting for heard in lines):
            self.trouble, self.place = "it was reset, and the position is lost: home it", None
        self.check()
        return lines

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise HardwareError(f"the stage's port does not take bytes: {error}") from error
