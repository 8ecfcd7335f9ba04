"""Where the packets of a virtual board come out: a port that appears, is listened to or not, and goes away.

A port never waits: a packet for which there is no room, or nobody who listens, is dropped whole, as a board's
would be when its buffer is full. Bytes of a packet that has begun are sent before the next.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable


class AbstractOutlet(ABC):
    """A port; `open` and `close` may alternate, and it is told by the same name each time where that is
    possible.
    """

    @property
    @abstractmethod
    def url(self) -> str:
        """How a host opens it, while it is open."""

    @abstractmethod
    def open(self) -> None:
        """Make the port appear. Raises HardwareError when that is impossible."""

    @abstractmethod
    def close(self) -> None:
        """Make it go away; whoever listens is cut off. Does nothing where it is not open."""

    @property
    @abstractmethod
    def listened(self) -> bool:
        """Whether somebody has opened it."""

    @abstractmethod
    def offer(self, packet: bytes) -> bool:
        """Send a packet if there is somebody to listen and room for its first byte; whether that was so."""

    @abstractmethod
    def hear(self) -> bytes:
        """What the host has sent since the last time."""

    @abstractmethod
    def wait(self, seconds: float) -> None:
        """Wait until there is room again, for so long at most."""


class Backlog:
    """The rest of a packet whose first bytes have gone."""

    def __init__(self) -> None:
        self._rest = b""

    def clear(self) -> None:
        """Forget it: whoever had its beginning is gone."""
        self._rest = b""

    def send(self, packet: bytes, write: Callable[[bytes], int]) -> bool:
        """Send what is left, then a packet, by `write`, which returns how many bytes it took; whether the
        packet has begun.
        """
        if self._rest:
            self._rest = self._rest[write(self._rest) :]
        if self._rest:
            return False
        taken = write(packet)
        if taken:
            self._rest = packet[taken:]
        return taken > 0
