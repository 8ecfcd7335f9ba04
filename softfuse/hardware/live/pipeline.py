"""From the chunks of all sources to frames of all channels: deterministic, without clocks and threads.

Each source has a driver that finds samples in its bytes. Each device behind it has a watch on its sequence
numbers and a clock that turns its time into the host's; late and doubled samples are counted and left out. An
empty chunk says that the line was cut there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from softfuse.hardware.device_clock import ClockReport, DeviceClock
from softfuse.hardware.live.assembler import Assembled, Assembler
from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.hardware.stream import Chunk, Notice
from softfuse.hardware.wire.sequence import Arrival, SequenceCounts, SequenceWatch


@dataclass(frozen=True)
class DeviceReport:
    """What has come from one device."""

    source: int
    device: int
    samples: SequenceCounts
    clock: ClockReport


@dataclass(slots=True)
class _Device:
    number: int
    watch: SequenceWatch = field(default_factory=SequenceWatch)
    clock: DeviceClock = field(default_factory=DeviceClock)
    names: tuple[str, ...] = ()


class Pipeline:
    """Turns chunks into frames of the wanted channels."""

    def __init__(self, wanted: Sequence[str], drivers: Sequence[AbstractDriver]):
        """`wanted`: names of the channels of a frame; `drivers`: one for each source."""
        self.wanted = tuple(wanted)
        self._assembler = Assembler(wanted)
        self._drivers = tuple(drivers)
        self._devices: dict[tuple[int, int], _Device] = {}

    @property
    def missing(self) -> list[str]:
        """Wanted channels that nothing has given yet."""
        return self._assembler.missing

    @property
    def devices(self) -> list[DeviceReport]:
        """What has come from each device."""
        return [
            DeviceReport(source, device, replace(seen.watch.counts), seen.clock.report)
            # A copy: another thread may ask while a device is heard of for the first time.
            for (source, device), seen in list(self._devices.items())
        ]

    @property
    def counts(self) -> list[Mapping[str, int]]:
        """What became of the bytes of each source, by what people call it."""
        return [driver.counts for driver in self._drivers]

    def take_requests(self, source: int) -> bytes:
        """What the last chunks of a source ask to be sent to it now."""
        return self._drivers[source].take_requests()

    def feed(self, chunk: Chunk) -> tuple[list[Assembled], list[Notice]]:
        """The frames that a chunk completes and what is to be told about it, in order."""
        driver = self._drivers[chunk.source]
        if not chunk.data:
            driver.interrupted()
            return [], []
        frames: list[Assembled] = []
        notices: list[Notice] = []
        for reading in driver.feed(chunk.data, chunk.host_s):
            frames += self._assemble(chunk.source, reading, notices)
        notices += [replace(notice, source=chunk.source) for notice in driver.take_notices()]
        return frames, notices

    def _assemble(self, source: int, reading: Reading, notices: list[Notice]) -> list[Assembled]:
        key = source, reading.device
        device = self._devices.get(key)
        if device is None:
            device = self._devices[key] = _Device(len(self._devices))

        def tell(text: str) -> None:
            notices.append(Notice(reading.host_s, source, "warning", f"device {reading.device}: {text}"))

        time_s = reading.host_s
        if reading.sequence is not None and reading.device_time_us is not None:
            place = device.watch.place(reading.sequence, reading.device_time_us)
            if place.arrival is Arrival.RESTARTED:
                device.clock.restart()
                tell("has restarted")
            elif place.arrival is not Arrival.FRESH:
                return []
            elif place.missing:
                tell(f"{place.missing} samples lost before sample {reading.sequence}")
        # Devices that do not count, such as boards that print lines, have a clock all the same.
        if reading.device_time_us is not None:
            time_s = device.clock.stamp(reading.device_time_us, reading.host_s)
        if reading.names is not device.names and reading.names != device.names:
            device.names = reading.names
            doubled = self._assembler.describe(device.number, reading.names)
            if doubled:
                tell(
                    f"the channels {', '.join(doubled)} come from another device already, these are left out"
                )
        return self._assembler.add(device.number, time_s, reading.values, reading.host_s)
