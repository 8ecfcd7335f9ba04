"""From the chunks of all sources to frames of all channels: deterministic, without clocks and threads.

Each source has a driver that finds samples in its bytes. Each device behind it has a watch on its sequence
numbers and a clock that turns its time into the host's; late and doubled samples are counted and left out. An
empty chunk says that the line was cut there.

Frames of all channels are assembled out of samples that come from several devices. The device that has most
of the wanted channels sets the pace: there is a frame at each of its samples' times t. What other devices
measured at t is interpolated between their samples before and after it,

    v(t) = v_k + (v_{k+1} − v_k) (t − t_k) / (t_{k+1} − t_k),

so a frame waits until each of them has given a sample that is not older than t. It waits until a sample of
its own device has come that is later than t by `PATIENCE_S`; what has not come by then is the other device's
last value. A device without a sample within `PATIENCE_S` of t says nothing about t: NaN.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from softfuse.hardware.device_clock import ClockReport, DeviceClock
from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.hardware.stream import Chunk, Notice
from softfuse.hardware.wire.sequence import Arrival, SequenceCounts, SequenceWatch

PATIENCE_S = 0.05
"""How much later than a frame its own device may have come before the frame goes without the others [s]."""

MOST_WAITING = 512
"""Frames that may wait; the oldest goes as it is when there are more."""


@dataclass(frozen=True, slots=True)
class Assembled:
    """All wanted channels at one time."""

    time_s: float
    """Seconds since the epoch."""
    values: Float[np.ndarray, " n"]
    """(n,) in the order of the wanted channels and the units of their names; NaN where missing."""
    arrived_s: float
    """When the bytes that completed it had been read [s since the epoch]."""


@dataclass(slots=True)
class _Feed:
    """What one device gives: which of its values are wanted, where they go, and its last samples."""

    take: Int[np.ndarray, " m"]
    put: Int[np.ndarray, " m"]
    samples: deque[tuple[float, Float[np.ndarray, " m"]]] = field(default_factory=lambda: deque(maxlen=1024))

    def settled(self, time_s: float) -> bool:
        """Whether it has a sample that is not older."""
        return bool(self.samples) and self.samples[-1][0] >= time_s

    def at(self, time_s: float) -> Float[np.ndarray, " m"]:
        """Its values at a time: interpolated, or the last ones, NaN without a sample near that time."""
        before = after = None
        for sample in self.samples:
            if sample[0] >= time_s:
                after = sample
                break
            before = sample
        near = [s for s in (before, after) if s is not None and abs(s[0] - time_s) <= PATIENCE_S]
        if not near:
            return np.full(len(self.put), np.nan)
        if before is None or after is None:
            return near[0][1]
        share = (time_s - before[0]) / (after[0] - before[0])
        return before[1] + share * (after[1] - before[1])

    def forget(self, time_s: float) -> None:
        """Drop what no frame from this time on needs: all but the last sample before it."""
        while len(self.samples) > 1 and self.samples[1][0] <= time_s:
            self.samples.popleft()


class Assembler:
    """Assembles the frames of one set of senses from the samples of any number of devices."""

    def __init__(self, wanted: Sequence[str]):
        """`wanted`: names of the channels that a frame has."""
        self._index = {name: k for k, name in enumerate(wanted)}
        self._feeds: dict[int, _Feed] = {}
        self._pace: int | None = None
        self._waiting: deque[float] = deque()

    @property
    def missing(self) -> list[str]:
        """Wanted channels that no device has given yet."""
        # A copy: another thread may ask while a device describes itself.
        given = {int(k) for feed in list(self._feeds.values()) for k in feed.put}
        return [name for name, k in self._index.items() if k not in given]

    def describe(self, device: int, names: Sequence[str]) -> list[str]:
        """Say which channels a device gives, before its first sample and when that changes.

        Returns the wanted channels among them that another device gives already: those stay the other's.
        """
        taken = {int(k) for other, feed in self._feeds.items() if other != device for k in feed.put}
        wanted = [(i, self._index[name]) for i, name in enumerate(names) if name in self._index]
        doubled = [names[i] for i, k in wanted if k in taken]
        own = np.array([(i, k) for i, k in wanted if k not in taken], int).reshape(-1, 2)
        self._feeds.pop(device, None)
        if len(own):
            self._feeds[device] = _Feed(own[:, 0], own[:, 1])
        most = max((len(feed.put) for feed in self._feeds.values()), default=0)
        leading = [device for device, feed in self._feeds.items() if len(feed.put) == most]
        if self._pace not in leading:
            self._pace = min(leading, default=None)
            self._waiting.clear()
        return doubled

    def add(
        self, device: int, time_s: float, values: Float[np.ndarray, " k"], arrived_s: float
    ) -> list[Assembled]:
        """The frames that a described device's sample at `time_s` [s since the epoch] completes, in order.

        `values` (k,): in the order in which the device's channels were described. A sample that is not newer
        than its device's last one is left out.
        """
        feed = self._feeds.get(device)
        if feed is None or (feed.samples and time_s <= feed.samples[-1][0]):
            return []
        feed.samples.append((time_s, np.asarray(values, float)[feed.take]))
        if device == self._pace:
            self._waiting.append(time_s)
        done = []
        while self._waiting and self._complete(self._waiting[0]):
            done.append(self._frame(self._waiting.popleft(), arrived_s))
        return done

    def _complete(self, time_s: float) -> bool:
        newest = self._waiting[-1]
        if newest - time_s > PATIENCE_S or len(self._waiting) > MOST_WAITING:
            return True
        return all(feed.settled(time_s) for feed in self._feeds.values())

    def _frame(self, time_s: float, arrived_s: float) -> Assembled:
        values = np.full(len(self._index), np.nan)
        for feed in self._feeds.values():
            values[feed.put] = feed.at(time_s)
            feed.forget(time_s)
        return Assembled(time_s, values, arrived_s)


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
