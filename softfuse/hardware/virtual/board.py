"""A board that samples its sensors and speaks the wire protocol: from true time to packets, without any I/O.

It describes itself at power-on, every second of its own time and when asked; samples carry its own time and a
sequence number that also counts those that are lost.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.hardware.virtual.board_clock import BoardClock
from softfuse.hardware.virtual.faults import NO_FAULTS, FaultySensors, SensorFaults
from softfuse.hardware.wire.decoder import Decoder
from softfuse.hardware.wire.description import Description, Layout
from softfuse.hardware.wire.message import (
    EVERY_DEVICE,
    AskMessage,
    DescriptionMessage,
    Header,
    Message,
    SampleMessage,
    encode,
    pack,
)
from softfuse.hardware.wire.sequence import MODULUS

DESCRIBE_US = 1_000_000
"""Time between descriptions [µs]."""

MOST_AT_ONCE = 256
"""Samples that are read together at most."""

Read = Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, "m k"]]
"""Values (m, k) of a board's channels at true times (m,) s, which increase from call to call."""


@dataclass
class BoardCounts:
    """What a board has done since it was made.

    samples: packed; lost: left out; descriptions; answers: descriptions among them that were asked for;
    power_ons.
    """

    samples: int = 0
    lost: int = 0
    descriptions: int = 0
    answers: int = 0
    power_ons: int = 0


class VirtualBoard:
    """One device of a number, as it describes itself, with the sensors that `read` stands for."""

    def __init__(
        self,
        device: int,
        description: Description,
        read: Read,
        clock: BoardClock,
        *,
        faults: SensorFaults = NO_FAULTS,
        seed: Sequence[int] = (0,),
    ) -> None:
        """`seed`: of the faults. Nothing is read and no time passes before `switch_on`."""
        self._device, self._read, self._clock = device, read, clock
        self.description = description
        """What it says about itself."""
        self.counts = BoardCounts()
        """What it has done so far."""
        self._layout = Layout(description)
        self._faulty = FaultySensors(description.names, faults, seed)
        self._host = Decoder()
        self._on_s = 0.0
        self._next = 0
        self._described_us = 0

    @property
    def next_s(self) -> float:
        """True time [s] of its next sample."""
        return self._on_s + self._clock.true_s(self._next)

    def switch_on(self, true_s: float) -> list[bytes]:
        """The first packets when it begins, or begins anew, at a true time [s] after those of all samples."""
        self._on_s, self._next = true_s, 0
        self.counts.power_ons += 1
        self._host = Decoder()
        # The empty packet ends what a bootloader may have printed.
        return [b"\0", self._describe(self._clock.device_us(0))]

    def due(self, true_s: float) -> int:
        """How many samples are due at a true time [s]."""
        return max(0, self._clock.due(true_s - self._on_s) - self._next)

    def take(self, count: int) -> list[bytes]:
        """The packets of the next `count` samples, and the descriptions that fall between them."""
        packets: list[bytes] = []
        while count > 0:
            few = min(count, MOST_AT_ONCE)
            packets += self._take(few)
            count -= few
        return packets

    def hear(self, data: bytes) -> list[bytes]:
        """The packets that answer the next bytes from the host."""
        packets = []
        for received in self._host.feed(data, 0.0):
            message = received.message
            if isinstance(message, AskMessage) and message.header.device in (self._device, EVERY_DEVICE):
                self.counts.answers += 1
                packets.append(self._describe(self._clock.device_us(max(0, self._next - 1))))
        return packets

    def _take(self, count: int) -> list[bytes]:
        numbers = range(self._next, self._next + count)
        since_on = np.array([self._clock.true_s(number) for number in numbers])
        values = np.array(self._read(self._on_s + since_on))
        self._faulty.spoil(self._on_s + since_on, values)
        packets = []
        for number, sample, lost in zip(numbers, values, self._faulty.lose(count).tolist(), strict=True):
            time_us = self._clock.device_us(number)
            if time_us - self._described_us >= DESCRIBE_US:
                packets.append(self._describe(time_us))
            self._next = number + 1
            if lost:
                self.counts.lost += 1
                continue
            header = Header(self._device, number % MODULUS, time_us)
            packets.append(_packed(SampleMessage(header, self._layout.number, self._layout.content(sample))))
            self.counts.samples += 1
        return packets

    def _describe(self, time_us: int) -> bytes:
        self._described_us = time_us
        self.counts.descriptions += 1
        header = Header(self._device, self._next % MODULUS, time_us)
        return _packed(DescriptionMessage(header, self.description))


def _packed(message: Message) -> bytes:
    return pack(encode(message))
