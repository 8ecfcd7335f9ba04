"""A board that samples its sensors and speaks the wire protocol: from true time to packets, without any I/O.

It describes itself at power-on, every second of its own time and when asked; samples carry its own time and a
sequence number that also counts those that are lost. Before a sample is packed it may be lost, then it is not
sent; and sensors die: a silent channel is no longer read (NaN on the host), a stuck one repeats what it read
last.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import HardwareError
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

LARGEST_DRIFT_PPM = 50_000.0

DESCRIBE_US = 1_000_000
"""Time between descriptions [µs]."""

MOST_AT_ONCE = 256
"""Samples that are read together at most."""

Read = Callable[[Float[np.ndarray, " m"]], Float[np.ndarray, "m k"]]
"""Values (m, k) of a board's channels at true times (m,) s, which increase from call to call."""


@dataclass(frozen=True)
class BoardClock:
    """A board's own clock, which starts anywhere and runs too fast or too slowly.

        device time = start + (1 + d) t

    for true time t since power-on and drift d; a sample is taken whenever it has gone on by a period.

    Samples per second of its own time, at most one a microsecond; its time [µs] at power-on; its drift
    [ppm], positive where it is fast.
    """

    rate_Hz: float
    start_us: int = 0
    drift_ppm: float = 0.0

    def __post_init__(self) -> None:
        if not 1.0 <= self.rate_Hz <= 1e5:
            raise HardwareError(f"{self.rate_Hz:g} samples per second: give a rate from 1 to 100000 Hz")
        if not abs(self.drift_ppm) <= LARGEST_DRIFT_PPM:
            raise HardwareError(
                f"a clock that is off by {self.drift_ppm:g} ppm: give at most {LARGEST_DRIFT_PPM:g}"
            )

    def device_us(self, sample: int) -> int:
        """Its time [µs] at a sample, counted from power-on."""
        return self.start_us + round(sample * 1e6 / self.rate_Hz)

    def true_s(self, sample: int) -> float:
        """True time [s] since power-on at a sample."""
        return sample / (self.rate_Hz * (1.0 + 1e-6 * self.drift_ppm))

    def due(self, true_s: float) -> int:
        """Samples that are due at a true time [s] since power-on, the one at power-on included."""
        if true_s < 0.0:
            return 0
        count = int(true_s * self.rate_Hz * (1.0 + 1e-6 * self.drift_ppm)) + 1
        # Rounding must not let a sample be due before its time, or forget one that is.
        while self.true_s(count - 1) > true_s:
            count -= 1
        while self.true_s(count) <= true_s:
            count += 1
        return count


@dataclass(frozen=True)
class DeadSensor:
    """A channel that is silent, or else stuck, from a true time [s]."""

    channel: str
    from_s: float
    silent: bool


@dataclass(frozen=True)
class SensorFaults:
    """Share of samples that are lost [-], and sensors that die."""

    lost: float = 0.0
    dead: tuple[DeadSensor, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.lost < 1.0:
            raise HardwareError(f"a share of {self.lost:g} of the samples cannot be lost: give 0 to below 1")


NO_FAULTS = SensorFaults()
"""Nothing goes wrong."""


class FaultySensors:
    """Applies faults to the samples of one board; the same seed loses the same samples."""

    def __init__(self, names: Sequence[str], faults: SensorFaults, seed: Sequence[int]) -> None:
        """names: the board's channels; faults of other boards' channels are left out."""
        self._lost = faults.lost
        self._rng = np.random.default_rng(np.random.SeedSequence(list(seed)))
        self._dead = [
            (list(names).index(dead.channel), dead) for dead in faults.dead if dead.channel in names
        ]
        self._last: dict[int, float] = {}

    def spoil(self, time_s: Float[np.ndarray, " m"], values: Float[np.ndarray, "m k"]) -> None:
        """Change the values (m, k) of samples taken at true times (m,) s in place."""
        for column, dead in self._dead:
            gone = time_s >= dead.from_s
            if dead.silent:
                values[gone, column] = np.nan
            else:
                if not gone.all():
                    self._last[column] = float(values[~gone, column][-1])
                values[gone, column] = self._last.setdefault(column, float(values[0, column]))

    def lose(self, count: int) -> Float[np.ndarray, " m"]:
        """Which of the next samples (m,) are lost."""
        if self._lost == 0.0:
            return np.zeros(count, bool)
        return self._rng.random(count) < self._lost


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
