"""All that the sensors of a test bed say, as frames with the truth beside them, written down as they come.

A thread turns the chunks of all sources into frames (`live.pipeline`) and adds, from what the bench says that
it does, where the stage last stood and the columns `press, sample, true_x_mm, true_y_mm, true_force_N`. The
force is the pressing one, sign (reading − zero). A frame with a sample carries the mean force over the end of
its hold. Frames are written from the first press on, when zero and place are known; what came before is in
the chunks.
"""

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softfuse.errors import ConfigError, HardwareError
from softfuse.hardware.live.pipeline import Assembled, Pipeline
from softfuse.hardware.record.entries import FrameEntry, SessionInfo
from softfuse.hardware.source.configured import connection_of, driver_of
from softfuse.hardware.stage.gcode import GcodeStage
from softfuse.hardware.stream import Chunk, HostClock, Notice
from softfuse.hardware.testbed.files import Outputs
from softfuse.hardware.testbed.places import LABELS
from softfuse.hardware.testbed.procedure import beyond
from softfuse.robot.robot import require_sensors
from softfuse.robot.settings import RobotSettings

STAGE = ("stage_x_mm", "stage_y_mm", "stage_z_mm")
"""Columns of where the stage last stood, in its own coordinates."""
STALE_S = 0.4
"""A force that is older says nothing about now [s]."""
PATIENCE_S = 2.0
"""How long a frame is waited for [s]."""
_INBOX = 20_000
_KEPT = 20_000


@dataclass(frozen=True)
class ForceAxis:
    """The channel of the force along the indenter, and the sign, 1 or -1, that makes pressing positive."""

    channel: str
    sign: float

    def __post_init__(self) -> None:
        if self.sign not in (-1, 1):
            raise HardwareError(
                f"the force sign {self.sign:g}: give 1, or -1 where pressing makes the force fall"
            )


@dataclass(frozen=True)
class Label:
    """What is done now: the number of the press, its place in the body's coordinates [m], what the force's
    channel says without load, and where the stage last stood [m]; NaN where not known yet.
    """

    press: int
    at: tuple[float, float] = (np.nan, np.nan)
    zero: float = np.nan
    stage: tuple[float, float, float] = (np.nan, np.nan, np.nan)


@dataclass(frozen=True, slots=True)
class _Felt:
    time_s: float
    arrived_s: float
    reading: float


class Gathering:
    """Opens the configuration's sources and gathers what they say."""

    def __init__(
        self, config: RobotSettings, axis: ForceAxis, clock: HostClock, *, tell: Callable[[Notice], None]
    ) -> None:
        """`tell`: called with what people should know.

        ConfigError where the configuration has no sensors or no sources.
        """
        if not config.sources:
            raise ConfigError(
                f"{config.path}: source: missing; write a [[source]] for the device and the force sensor"
            )
        require_sensors(config)
        known = (name for source in config.sources for name in source.known_channels)
        wanted = list(dict.fromkeys((*config.channels, *known, axis.channel)))
        drivers = [driver_of(source) for source in config.sources]
        self._pipeline, self._axis, self._clock, self._tell = Pipeline(wanted, drivers), axis, clock, tell
        self._inbox: queue.Queue[Chunk | Notice | None] = queue.Queue(_INBOX)
        self._connections = [
            connection_of(k, source, driver, self._inbox.put, self.tell, clock)
            for k, (source, driver) in enumerate(zip(config.sources, drivers, strict=True))
        ]
        self._index = wanted.index(axis.channel)
        self._outputs: Outputs | None = None
        self._felt: deque[_Felt] = deque(maxlen=_KEPT)
        self._changed = threading.Condition()
        self._label = Label(press=0)
        self._mark: tuple[int, float] | None = None
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._guarded, name="softfuse gathering", daemon=True)
        self._frames = 0

    @contextmanager
    def recording(
        self,
        open_stage: Callable[[], GcodeStage],
        files: Sequence[Path],
        info_of: Callable[[tuple[str, ...]], SessionInfo],
    ) -> Iterator[GcodeStage]:
        """The stage, while all that comes from the sources is written to files; then everything is closed.

        info_of: what a session of such channels says first. Raises HardwareError where a port cannot be
        opened or the disk fails, RecordingError where a file cannot be written.
        """
        try:
            for connection in self._connections:
                connection.open()
            with closing(open_stage()) as stage:
                # Not before every port is open: a mistake in one leaves no file.
                info = info_of((*self._pipeline.wanted, *STAGE, *LABELS))
                self._outputs = Outputs(files, info, self._clock, self._tell)
                self._thread.start()
                yield stage
        finally:
            self._stop()
        if self._outputs is not None and self._outputs.lost:
            raise HardwareError(
                f"{self._outputs.lost} entries could not be recorded to {self.written}: look at the disk"
            )

    @property
    def written(self) -> str:
        """The files."""
        return "" if self._outputs is None else ", ".join(map(str, self._outputs.files))

    def tell(self, notice: Notice) -> None:
        """Write down and show what people should know; from any thread."""
        self._inbox.put(notice)

    def remark(self, text: str) -> None:
        """Write down what is done."""
        self.tell(Notice(self._clock.now_s(), None, "info", text))

    def missing(self, seconds: float) -> list[str]:
        """The channels that nothing has given yet, after at most so many seconds; none as soon as all came.

        HardwareError where what comes cannot be written down.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._failure is not None or not self._pipeline.missing, seconds)
        if self._failure is not None:
            raise HardwareError(self._unwritten)
        return self._pipeline.missing

    @property
    def label(self) -> Label:
        """What is done now."""
        return self._label

    def relabel(self, **changes: object) -> None:
        """Say what is done from now on: fields of `Label`."""
        with self._changed:
            self._label = replace(self._label, **changes)

    def trouble(self, force_limit: float) -> str | None:
        """Why nobody should press now: a force beyond the limit [N], or one that is not known any more."""
        if self._failure is not None:
            return self._unwritten
        with self._changed:
            known = next((one for one in reversed(self._felt) if np.isfinite(one.reading)), None)
        if known is None or self._clock.now_s() - known.arrived_s > STALE_S:
            return self._absent
        force = self._force(known.reading)
        return beyond(force_limit, force) if abs(force) > force_limit else None

    def reading(self, seconds: float) -> float:
        """The mean of the force's channel over the next so many seconds, as the sensor has it.

        HardwareError where no frame comes for `PATIENCE_S`, or none with the force.
        """
        start = self._clock.now_s()
        with self._changed:
            came = self._changed.wait_for(
                lambda: (
                    self._failure is not None
                    or (bool(self._felt) and self._felt[-1].time_s >= start + seconds)
                ),
                seconds + PATIENCE_S,
            )
            readings = [one.reading for one in self._felt if one.time_s >= start]
        readings = [reading for reading in readings if np.isfinite(reading)]
        if self._failure is not None:
            raise HardwareError(self._unwritten)
        if not came or not readings:
            raise HardwareError(self._absent)
        return float(np.mean(readings))

    def force(self, seconds: float) -> float:
        """The mean pressing force [N] over the next so many seconds; HardwareError as `reading`."""
        return self._force(self.reading(seconds))

    def mark(self, level: int, force: float) -> None:
        """Make the next frame the sample of a level (from 1) with this mean force [N], and wait for it.

        HardwareError where no frame comes for `PATIENCE_S`.
        """
        with self._changed:
            self._mark = level, force
            if not self._changed.wait_for(lambda: self._mark is None, PATIENCE_S):
                self._mark = None
                raise HardwareError(f"no frame for {PATIENCE_S:g} s: check the device with softfuse doctor")

    @property
    def _absent(self) -> str:
        return f"{self._axis.channel} does not come: look at the sensors with softfuse doctor"

    @property
    def _unwritten(self) -> str:
        return f"what was measured cannot be written down: {self._failure}"

    def _force(self, reading: float) -> float:
        return self._axis.sign * (reading - self._label.zero)

    def _stop(self) -> None:
        """Work off what has been received, then close; raises what the thread failed with."""
        for connection in self._connections:
            connection.stop()
        try:
            try:
                if self._thread.ident is not None:
                    self._inbox.put(None)
                    self._thread.join()
                if self._failure is not None:
                    raise self._failure
            finally:
                if self._outputs is not None:
                    self._outputs.close()
        except OSError as error:
            raise HardwareError(f"what was measured cannot be written down: {error}") from error

    def _guarded(self) -> None:
        try:
            self._run()
        except BaseException as failure:
            with self._changed:
                self._failure = failure
                self._changed.notify_all()
            # Whoever still reads must not wait for room.
            while self._inbox.get() is not None:
                pass

    def _run(self) -> None:
        assert self._outputs is not None  # before the thread starts
        write = self._outputs.write
        while (entry := self._inbox.get()) is not None:
            write(entry)
            if isinstance(entry, Notice):
                self._tell(entry)
                continue
            frames, notices = self._pipeline.feed(entry)
            if request := self._pipeline.take_requests(entry.source):
                self._connections[entry.source].send(request)
            for frame in frames:
                entry = self._entry(frame)
                if entry is not None:
                    write(entry)
            for notice in notices:
                write(notice)
                self._tell(notice)

    def _entry(self, frame: Assembled) -> FrameEntry | None:
        reading = float(frame.values[self._index])
        with self._changed:
            label, mark, self._mark = self._label, self._mark, None
            force = self._force(reading)
            self._felt.append(_Felt(frame.time_s, frame.arrived_s, reading))
            self._changed.notify_all()
        stage = 1e3 * np.array(label.stage)
        if not np.isfinite([label.zero, *stage]).all():
            return None
        level, force = mark or (0, force)
        truth = [label.press, level, 1e3 * label.at[0], 1e3 * label.at[1], force]
        entry = FrameEntry(self._frames, frame.time_s, np.concatenate([frame.values, stage, truth]))
        self._frames += 1
        return entry
