"""What a source says while it is listened to: which devices, with which channels, how fast and how faultless.

Delays only add, so the device's clock against the host's is the nearest line below the lateness
y = arrival - device time (`device_clock`). Each `BUCKETS`-th of the host's time gives it its sample of least
delay, and with (x0, y0), (x1, y1) the two that the line goes through,

    drift = (y1 - y0) / (x1 - x0),   known to ± (the largest of these least delays) / (x1 - x0)

in which a computer that stalled counts in full: it may have delayed the one and not the other. Two seconds of
samples that come late by a millisecond tell the drift to some hundred ppm. Jitter is the 95 % quantile of how
late the samples came; where a device tells no time, of how much the intervals differ from their median.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from softfuse.hardware.device_clock import edge_below
from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.hardware.stream import Chunk
from softfuse.hardware.wire.sequence import Arrival, SequenceCounts, SequenceWatch

MOST_SAMPLES = 200_000
"""Samples of a device that are kept; a minute at 3 kHz."""
MOST_DEVICES = 64
BUCKETS = 12
FEWEST_BUCKETS = 9
"""With samples; a drift told from fewer would be a guess."""
_FAULTS = (
    *("failures", "discarded", "too long", "malformed", "unknown", "another version", "not described"),
    *("before any header", "without their beginning", "in error", "not valid", "overloaded"),
)
"""Words in the counts of the drivers that say that something was wrong."""


@dataclass(frozen=True)
class Heard:
    """What one device said.

    device: its number; channels: their names; never_read: those that never had a value; samples: how many
    came; rate_Hz: of its samples, the lost ones included; counts: of what was lost, late and doubled, None
    for a device that does not count; drift_ppm: of its clock, and to what it is known; None for a device that
    tells no time; jitter_s. NaN where there are too few samples.
    """

    device: int
    channels: tuple[str, ...]
    never_read: tuple[str, ...]
    samples: int
    rate_Hz: float
    counts: SequenceCounts | None
    drift_ppm: tuple[float, float] | None
    jitter_s: float


@dataclass(slots=True)
class _Device:
    names: tuple[str, ...] = ()
    read: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    watch: SequenceWatch = field(default_factory=SequenceWatch)
    counted: bool = False
    host_s: list[float] = field(default_factory=list)
    device_us: list[int] = field(default_factory=list)


class Listener:
    """Listens to one source by its driver; not thread-safe."""

    def __init__(self, driver: AbstractDriver) -> None:
        self._driver = driver
        self._devices: dict[int, _Device] = {}
        self._before: Mapping[str, int] | None = None
        self.bytes = 0
        """How many came."""
        self.first_s: float | None = None
        """When the first sample came [s since the epoch]."""
        self.last_s: float | None = None
        """When the newest did."""
        self.remarks: list[str] = []
        """What the device wants people to know."""

    def feed(self, chunk: Chunk) -> bytes:
        """Take what was read; what is to be sent in answer."""
        if not chunk.data:
            self._driver.interrupted()
            return b""
        self.bytes += len(chunk.data)
        for reading in self._driver.feed(chunk.data, chunk.host_s):
            self._hear(reading)
            self.last_s = chunk.host_s
        if self._before is None and self._devices:
            # A packet that was under way when the port was opened is no fault.
            self._before, self.first_s = dict(self._driver.counts), chunk.host_s
        self.remarks += [notice.text for notice in self._driver.take_notices()]
        return self._driver.take_requests()

    @property
    def faults(self) -> dict[str, int]:
        """What was wrong with the bytes since the first sample, or with all of them without any."""
        before = self._before or {}
        counts = {key: number - before.get(key, 0) for key, number in self._driver.counts.items()}
        return {key: n for key, n in counts.items() if n > 0 and any(word in key for word in _FAULTS)}

    @property
    def heard(self) -> list[Heard]:
        """What each device has said."""
        return [_heard(number, device) for number, device in sorted(self._devices.items())]

    def _hear(self, reading: Reading) -> None:
        device = self._devices.get(reading.device)
        if device is None:
            if len(self._devices) >= MOST_DEVICES:
                return
            device = self._devices[reading.device] = _Device()
        if reading.names != device.names:
            device.names, device.read = reading.names, np.zeros(len(reading.names), bool)
        device.read |= np.isfinite(reading.values)
        if reading.sequence is not None and reading.device_time_us is not None:
            device.counted = True
            arrival = device.watch.place(reading.sequence, reading.device_time_us).arrival
            if arrival is Arrival.RESTARTED:
                device.host_s.clear()
                device.device_us.clear()
            elif arrival is not Arrival.FRESH:
                return
        if len(device.host_s) < MOST_SAMPLES:
            device.host_s.append(reading.host_s)
            if reading.device_time_us is not None:
                device.device_us.append(reading.device_time_us)


def _heard(number: int, device: _Device) -> Heard:
    host = np.array(device.host_s)
    counts = device.watch.counts if device.counted else None
    timed = len(device.device_us) == len(host) and len(host) > 0
    own = 1e-6 * (np.array(device.device_us) - device.device_us[0]) if timed else host - host[:1]
    rate, drift, jitter = math.nan, (math.nan, math.nan), math.nan
    span = float(own[-1] - own[0]) if len(own) else 0.0
    if len(host) > 2 and span > 0.0:
        rate = (len(own) - 1 + (counts.lost if counts else 0)) / span
        if timed:
            drift, jitter = _against(own, host)
        else:
            steps = np.diff(host)
            jitter = float(np.percentile(np.abs(steps - np.median(steps)), 95))
    return Heard(
        number,
        device.names,
        tuple(name for name, read in zip(device.names, device.read, strict=True) if not read),
        len(host),
        rate,
        counts,
        drift if timed else None,
        jitter,
    )


def _against(own: np.ndarray, host: np.ndarray) -> tuple[tuple[float, float], float]:
    """Drift and to what it is known [ppm], and jitter [s], of arrivals (n,) at a device's times (n,) [s]."""
    late = host - host[0] - own
    # Of the host's time: what a stall held up comes all at once, and tells no more than one sample.
    edges = np.linspace(host[0], host[-1], BUCKETS + 1)[1:-1]
    buckets = np.searchsorted(edges, host)
    members = [np.flatnonzero(buckets == k) for k in np.unique(buckets)]
    least = np.array([some[np.argmin(late[some])] for some in members])
    if len(least) < FEWEST_BUCKETS:
        return (math.nan, math.nan), float(np.percentile(late - late.min(), 95))
    (x0, y0), (x1, y1) = edge_below(list(zip(own[least].tolist(), late[least].tolist(), strict=True)))
    slope = (y1 - y0) / (x1 - x0)
    delay = late - y0 - slope * (own - x0)
    error = float(delay[least].max()) / (x1 - x0)
    return (1e6 * slope, 1e6 * error), float(np.percentile(delay, 95))
