"""What the bytes of a source mean.

A driver is a function of the chunks that were fed to it: it asks no clock and does no I/O, so that the same
chunks give the same readings. What it wants to be sent, it hands out.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping

from softfuse.hardware.source.reading import Reading
from softfuse.hardware.stream import Notice


class AbstractDriver(ABC):
    """The meaning of one source's bytes."""

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

    @abstractmethod
    def greeting(self) -> tuple[bytes, ...]:
        """What is to be sent after opening and after a silence, with a pause after each part."""

    @abstractmethod
    def farewell(self) -> bytes:
        """What is to be sent before closing."""

    @abstractmethod
    def take_requests(self) -> bytes:
        """What the last chunks ask to be sent now; each is handed out once."""

    @abstractmethod
    def take_notices(self) -> list[Notice]:
        """What people should know of the last chunks, of source None; each is handed out once."""
