"""The live loop: sources, recorder and estimator, each on a thread of its own, none waiting for another.

    connections --chunks--> assembling thread --frames--> estimating thread --> publishers
                                   \\--chunks, frames, notices-->  recorder  <--estimates--/

The assembling thread does what takes microseconds; the estimating thread takes all frames that have come
since its last estimate, senses each and estimates the newest. Only there, in a bounded queue, frames are ever
dropped, oldest first and counted. Publishers are called from the estimating thread and must return at once.
"""

import math
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Frame
from softfuse.hardware.live.pipeline import Assembled, DeviceReport, Pipeline
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry
from softfuse.hardware.stream import Chunk, HostClock, Notice

_LEAST_S, _MOST_S, _RATIO = 1e-5, 1e3, 1.02
_BINS = math.ceil(math.log(_MOST_S / _LEAST_S) / math.log(_RATIO)) + 2
INBOX_LENGTH = 256
"""Chunks that may wait to be assembled."""
Fields = Mapping[str, float | str | None]
"""What people read of an estimate, by the columns' names."""


class FrameQueue:
    """A bounded queue of numbered frames between the thread that makes them and the one that estimates.

    When it is full the oldest frame goes, counted: an estimate of now is worth more than one of a second ago.
    Only the estimator loses it, recorders have it already.
    """

    def __init__(self, length: int):
        """`length`: how many frames may wait."""
        self._frames: deque[tuple[int, Assembled]] = deque()
        self._length = length
        self._changed = threading.Condition()
        self._closed = False
        self.dropped = 0
        """Frames that the estimator never saw."""

    @property
    def waiting(self) -> int:
        """Frames that wait now."""
        return len(self._frames)

    def put(self, number: int, frame: Assembled) -> None:
        """Append a frame; never blocks."""
        with self._changed:
            if len(self._frames) >= self._length:
                self._frames.popleft()
                self.dropped += 1
            self._frames.append((number, frame))
            self._changed.notify()

    def take(self) -> list[tuple[int, Assembled]]:
        """All frames that wait, at least one, oldest first; none once it is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._closed)
            frames = list(self._frames)
            self._frames.clear()
            return frames

    def close(self) -> None:
        """Nothing more will come."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class Latencies:
    """Quantiles of times from 10 µs to 1000 s in constant memory: counts in bins whose widths grow by 2 %."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, np.int64)
        self.largest_s = 0.0
        """The largest one [s]; 0 without any."""

    def add(self, seconds: float) -> None:
        """Count one; what is below 10 µs counts as that."""
        at = math.ceil(math.log(max(seconds, _LEAST_S) / _LEAST_S) / math.log(_RATIO))
        self._counts[min(at, _BINS - 1)] += 1
        self.largest_s = max(self.largest_s, seconds)

    def quantile_s(self, share: float) -> float:
        """The time [s] that a share of all is not above, rounded up by at most 2 %; NaN without any."""
        total = self._counts.sum()
        if total == 0:
            return math.nan
        at = int(np.searchsorted(np.cumsum(self._counts), max(share * total, 1.0)))
        return min(_LEAST_S * _RATIO**at, self.largest_s)


class Estimating(Protocol):
    """What estimates a stream of frames of all channels, and reads estimates."""

    def follow(self, frames: Iterable[tuple[Frame, bool]]) -> Iterator[Estimate]:
        """See `estimation.stream.follow`."""
        ...

    def fields(self, now: Estimate) -> Fields:
        """What people read of an estimate."""
        ...


@dataclass(frozen=True, eq=False)
class Published:
    """An estimate for publishers.

    `number`: of the frame; `host_s`: its time in seconds since the epoch; `channels`: what was read, in the
    units of the names; `fields`: what people read of the estimate; `end_to_end_s`: from the last byte.
    """

    number: int
    host_s: float
    channels: Mapping[str, float]
    estimate: Estimate
    fields: Fields
    end_to_end_s: float


@dataclass(frozen=True)
class SessionReport:
    """What a session has done so far.

    `frames`: assembled; `sensed`, `estimated`: of these; `overruns`: frames that the estimator never saw;
    `recorder_lost`: entries that are in no file; latencies [s] from the last byte to the estimate;
    `line_counts`: what became of the bytes of each source, CRC failures and the like.
    """

    frames: int
    sensed: int
    estimated: int
    overruns: int
    waiting: int
    recorder_lost: int
    latency_p50_s: float
    latency_p99_s: float
    latency_max_s: float
    devices: tuple[DeviceReport, ...]
    line_counts: tuple[Mapping[str, int], ...]
    missing: tuple[str, ...]


class Session:
    """Runs until it is stopped; made before its connections are opened."""

    def __init__(
        self,
        pipeline: Pipeline,
        estimating: Estimating,
        clock: HostClock,
        *,
        queue_length: int = 1000,
        send: Callable[[int, bytes], object] = lambda source, data: None,
        publish: Sequence[Callable[[Published], None]] = (),
        notify: Sequence[Callable[[Notice], None]] = (),
    ):
        """`queue_length`: frames that may wait for the estimator;
        `send`: sends bytes to a source, soon;
        `publish`, `notify`: called with estimates and with what people should know.
        """
        self._pipeline, self._estimating, self._clock = pipeline, estimating, clock
        self._publish, self._notify, self._send = tuple(publish), tuple(notify), send
        self._inbox: queue.Queue[Chunk | None] = queue.Queue(INBOX_LENGTH)
        self._frames = FrameQueue(queue_length)
        self._latencies = Latencies()
        self._start_s: float | None = None
        self._batch: list[tuple[int, Assembled]] = []
        self._assembled = self._sensed = self._estimated = 0
        self._recorder: Recorder | None = None
        self._failure: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._guarded, args=(run,), name=f"softfuse {name}", daemon=True)
            for name, run in (("assembler", self._assemble), ("estimator", self._estimate))
        ]

    def start(self, recorder: Recorder | None = None) -> None:
        """Start to take chunks and, with a recorder, to record."""
        self._recorder = recorder
        for thread in self._threads:
            thread.start()

    def receive(self, chunk: Chunk | None) -> None:
        """Take what a source has read, or None for the end; from any thread.

        While thousands wait it holds the reader back, and the operating system's own buffer fills. Nothing is
        taken once a thread has failed, since nobody would empty the inbox.
        """
        while self._failure is None:
            try:
                self._inbox.put(chunk, timeout=0.2)
            except queue.Full:
                continue
            return

    def tell(self, notice: Notice) -> None:
        """Record and show what people should know; from any thread."""
        if self._recorder is not None:
            self._recorder.put(notice)
        self.show(notice)

    def show(self, notice: Notice) -> None:
        """Show what people should know, without recording it; from any thread."""
        for notify in self._notify:
            notify(notice)

    def stop(self) -> None:
        """Work off what has been received, then end; raises what a thread failed with."""
        if self._threads[0].ident is None:
            return  # never started
        self.receive(None)
        for thread in self._threads:
            thread.join()
        if self._recorder is not None:
            self._recorder.close()
        if self._failure is not None:
            raise self._failure

    @property
    def failed(self) -> bool:
        """Whether a thread has ended by a fault of softfuse, which `stop` raises."""
        return self._failure is not None

    @property
    def report(self) -> SessionReport:
        """What has been done so far."""
        return SessionReport(
            self._assembled,
            self._sensed,
            self._estimated,
            self._frames.dropped,
            self._frames.waiting,
            0 if self._recorder is None else self._recorder.lost,
            self._latencies.quantile_s(0.5),
            self._latencies.quantile_s(0.99),
            self._latencies.largest_s,
            tuple(self._pipeline.devices),
            tuple(self._pipeline.counts),
            tuple(self._pipeline.missing),
        )

    def _guarded(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as failure:
            self._failure = failure
            # The other thread ends too, whatever it waits for.
            self._frames.close()
            with suppress(queue.Full):
                self._inbox.put_nowait(None)

    def _assemble(self) -> None:
        while self._failure is None and (chunk := self._inbox.get()) is not None:
            self._record(chunk)
            frames, notices = self._pipeline.feed(chunk)
            if request := self._pipeline.take_requests(chunk.source):
                self._send(chunk.source, request)
            for frame in frames:
                if self._start_s is None:
                    self._start_s = frame.time_s
                self._record(FrameEntry(self._assembled, frame.time_s, frame.values))
                self._frames.put(self._assembled, frame)
                self._assembled += 1
            for notice in notices:
                self.tell(notice)
        self._frames.close()

    def _estimate(self) -> None:
        for estimate in self._estimating.follow(self._wanted()):
            self._estimated_batch(estimate)

    def _wanted(self) -> Iterator[tuple[Frame, bool]]:
        """All frames that have come, of which the newest is wanted each time."""
        while batch := self._frames.take():
            assert self._start_s is not None  # set with the first frame
            self._batch = batch
            for k, (_, frame) in enumerate(batch, start=1):
                yield Frame(frame.time_s - self._start_s, frame.values), k == len(batch)

    def _estimated_batch(self, estimate: Estimate) -> None:
        number, frame = self._batch[-1]
        tracked, fields = estimate.tracked, self._estimating.fields(estimate)
        now = self._clock.now_s()
        elapsed = now - frame.arrived_s
        self._sensed += len(self._batch)
        self._estimated += 1
        self._latencies.add(elapsed)
        self._record(
            EstimateEntry(
                number,
                frame.time_s,
                now,
                fields,
                tuple(str(status) for status in tracked.statuses),
                1e3 * tracked.latency_s,
                1e3 * elapsed,
                len(self._batch),
            )
        )
        channels = dict(zip(self._pipeline.wanted, frame.values.tolist(), strict=True))
        published = Published(number, frame.time_s, channels, estimate, fields, elapsed)
        for publish in self._publish:
            publish(published)

    def _record(self, entry: Chunk | FrameEntry | EstimateEntry) -> None:
        if self._recorder is not None:
            self._recorder.put(entry)


def besides_samples(report: SessionReport) -> list[str]:
    """What else came from each source, CRC failures and the like; empty where nothing did."""
    return [
        ", ".join(f"{count} {what}" for what, count in counts.items() if count and what != "samples")
        for counts in report.line_counts
    ]


def latency(report: SessionReport) -> str:
    """From the last byte to the estimate."""
    quantiles = report.latency_p50_s, report.latency_p99_s, report.latency_max_s
    half, most, largest = (f"{1e3 * q:.1f}" for q in quantiles)
    return f"{half} ms (50 %), {most} ms (99 %), {largest} ms at most, from the last byte"


def told(report: SessionReport) -> list[str]:
    """All of it, line by line."""
    lines = [
        f"{report.frames} frames, {report.estimated} estimates, {report.overruns} overruns",
        f"latency {latency(report)}" if report.estimated else "nothing was estimated",
    ]
    for device in report.devices:
        lines.append(
            f"source {device.source}, device {device.device}: {device.samples.fresh} samples, "
            f"{device.samples.lost} lost, {device.samples.late} late, {device.samples.duplicated} twice"
        )
    lines += [f"source {k}: {found}" for k, found in enumerate(besides_samples(report)) if found]
    if report.missing:
        lines.append(f"channels that never came: {', '.join(report.missing)}")
    return lines
