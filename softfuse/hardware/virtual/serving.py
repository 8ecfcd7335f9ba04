"""Serves virtual boards on ports: in real time, or as fast as somebody reads; and takes the ports away for a
while.

In real time a sample is sent when it is due by the monotonic clock, counted from the start, so that the mean
rate does not drift; what nobody listens to is dropped. As fast as it is read, nothing is dropped, boards go
on in step, and they wait where nobody listens.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from softfuse.errors import HardwareError
from softfuse.hardware.virtual.board import VirtualBoard
from softfuse.hardware.virtual.faults import FaultyLine, Outages
from softfuse.hardware.virtual.ports import AbstractOutlet

_PATIENCE_S = 0.02
"""How long it waits at most before it looks whether a host has asked something, or it is to end [s]."""

_AT_ONCE = 32
"""Samples of a board before the next board's turn, as fast as they are read."""


@dataclass(slots=True, eq=False)
class _Waiting:
    """A packet, the outlets that have not taken it yet, and whether one has."""

    packet: bytes
    left: list[AbstractOutlet]
    taken: bool = False


class VirtualPort:
    """A board on a line that ends in one or more outlets."""

    def __init__(self, board: VirtualBoard, line: FaultyLine, outlets: Sequence[AbstractOutlet]) -> None:
        self.board = board
        self._line = line
        self._outlets = tuple(outlets)
        self.plugged = False
        """Whether it is there."""
        self._waiting: deque[_Waiting] = deque()
        self.sent = self.unheard = 0
        """Packets that somebody's port took, and those that nobody took, so far."""
        self.outages = 0
        """How often it went away."""

    def __str__(self) -> str:
        """What has gone through it so far, for people."""
        counts = self.board.counts
        parts = [f"{counts.samples} samples", f"{self.sent} packets heard", f"{self.unheard} not"]
        parts += [
            f"{count} {what}"
            for count, what in (
                (counts.lost, "samples lost"),
                (self._line.dropped, "bytes dropped"),
                (self._line.flipped, "bits flipped"),
                (self.outages, "times away"),
            )
            if count
        ]
        return f"{self.board.description.name}: {', '.join(parts)}"

    @property
    def urls(self) -> list[str]:
        """How a host opens it."""
        return [outlet.url for outlet in self._outlets]

    @property
    def listened(self) -> bool:
        """Whether somebody listens."""
        # Each is asked, since that is how it takes a connection.
        there = [outlet.listened for outlet in self._outlets]
        return any(there)

    def plug(self) -> None:
        """Make it appear. Raises HardwareError when that is impossible, and nothing stays open then."""
        try:
            for outlet in self._outlets:
                outlet.open()
        except HardwareError:
            self.end()
            raise
        self.plugged = True

    def unplug(self) -> None:
        """Make it go away, for a while."""
        self.outages += 1
        self.end()

    def answers(self) -> list[bytes]:
        """Packets that answer what hosts have asked."""
        return [packet for outlet in self._outlets for packet in self.board.hear(outlet.hear())]

    def send(self, packets: Sequence[bytes]) -> None:
        """Send packets to whoever listens; where there is no room they are dropped."""
        for packet in packets:
            spoiled = self._line.carry(packet)
            taken = [outlet.offer(spoiled) for outlet in self._outlets]
            self._count(any(taken))

    def line_up(self, packets: Sequence[bytes]) -> None:
        """Keep packets until `drain` has sent them."""
        self._waiting.extend(_Waiting(self._line.carry(packet), list(self._outlets)) for packet in packets)

    def drain(self) -> bool:
        """Send what waits as far as there is room, to everybody who listens; whether nothing is left."""
        while self._waiting:
            first = self._waiting[0]
            behind = []
            for outlet in first.left:
                if outlet.offer(first.packet):
                    first.taken = True
                elif outlet.listened:
                    behind.append(outlet)
            first.left = behind
            if behind:
                return False
            self._count(self._waiting.popleft().taken)
        return True

    def wait(self, seconds: float) -> None:
        """Wait until there may be room again, for so long at most."""
        if self._waiting and self._waiting[0].left:
            self._waiting[0].left[0].wait(seconds)

    def end(self) -> None:
        """Make it go away for good."""
        self.plugged = False
        for outlet in self._outlets:
            outlet.close()
        while self._waiting:
            self._count(self._waiting.popleft().taken)

    def _count(self, taken: bool) -> None:
        self.sent += taken
        self.unheard += not taken


Pace = Callable[[Sequence[VirtualPort], float, threading.Event], None]
"""When boards take their samples: takes, answers and sends what there is at a time [s] since the start, and
waits a little, or until the event.
"""


def in_real_time(ports: Sequence[VirtualPort], elapsed_s: float, stop: threading.Event) -> None:
    """Send what is due, then wait for the next sample, or for a moment."""
    for port in ports:
        port.send(port.answers())
        port.send(port.board.take(port.board.due(elapsed_s)))
    soonest = min(port.board.next_s for port in ports)
    stop.wait(min(max(0.0, soonest - elapsed_s), _PATIENCE_S))


def as_fast_as_read(ports: Sequence[VirtualPort], elapsed_s: float, stop: threading.Event) -> None:
    """Send some samples of each board once all have sent theirs; where nobody listens, they wait."""
    del elapsed_s
    for port in ports:
        port.line_up(port.answers())
    behind = [port for port in ports if not port.drain()]
    if behind:
        behind[0].wait(_PATIENCE_S)
    elif not all(port.listened for port in ports):
        stop.wait(_PATIENCE_S)
    else:
        for port in ports:
            port.line_up(port.board.take(_AT_ONCE))


class VirtualDevice:
    """Boards on ports, served until stopped."""

    def __init__(
        self,
        ports: Sequence[VirtualPort],
        pace: Pace,
        *,
        outages: Outages | None = None,
        plugged: Callable[[Sequence[VirtualPort]], None] = lambda ports: None,
    ) -> None:
        """`plugged` is called each time when the ports have appeared, from the serving thread."""
        self._ports, self._pace, self._outages, self._plugged = tuple(ports), pace, outages, plugged
        self._stop = threading.Event()

    def run(self, for_s: float | None = None) -> None:
        """Open the ports and serve for so long, or until `stop`; then close them.

        Raises HardwareError when a port cannot be opened.
        """
        start = time.monotonic()
        try:
            self._plug(0.0, restart=True)
            while not self._stop.is_set():
                elapsed = time.monotonic() - start
                if for_s is not None and elapsed >= for_s:
                    break
                self._mind_outages(elapsed)
                self._pace(self._ports, elapsed, self._stop)
        finally:
            for port in self._ports:
                port.end()

    def stop(self) -> None:
        """End serving soon; from any thread."""
        self._stop.set()

    def _mind_outages(self, elapsed_s: float) -> None:
        if self._outages is None:
            return
        out = self._outages.out(elapsed_s)
        if out and self._ports[0].plugged:
            for port in self._ports:
                port.unplug()
        elif not out and not self._ports[0].plugged:
            self._plug(elapsed_s, restart=self._outages.powers)

    def _plug(self, elapsed_s: float, *, restart: bool) -> None:
        for port in self._ports:
            port.plug()
            if restart:
                # As fast as it is read, a board is ahead of the clock.
                port.send(port.board.switch_on(max(elapsed_s, port.board.next_s)))
        self._plugged(self._ports)
