"""An open port: bytes in and out, from whatever the operating system has.

A port belongs to one thread, but for `write` of the few bytes that a stage is stopped with.
"""

from abc import ABC, abstractmethod

WAIT_S = 0.05
"""How long a read waits for bytes [s]."""
WRITE_WAIT_S = 0.1
"""How long a write waits for a device that does not take bytes [s]."""
LARGEST_READ = 65536
"""Bytes that one read returns at most."""


class AbstractPort(ABC):
    """Something that is open."""

    @abstractmethod
    def read(self) -> bytes:
        """What has come, at once, or b"" when nothing has come for WAIT_S; one datagram where there are such.

        OSError when the port is gone.
        """

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send all of it; TimeoutError when the device takes no bytes, OSError when the port is gone."""

    @abstractmethod
    def close(self) -> None:
        """Close it; never raises, and may be repeated."""
