"""A recorded session through the same path again: the same bytes, the same frames, the same numbers.

What was estimated live depends on how fast the machine was: frames between two estimates were only sensed,
and those that an estimate came too late for, not even that. A replay therefore senses the frames that went
into the recorded estimates and estimates where they were made, at all frames where there are none, and then
every number is the same to the last bit, at whatever speed.
"""

import math
import time
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass

from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Frame
from softfuse.hardware.live.pipeline import Assembled, Pipeline
from softfuse.hardware.live.session import Estimating, Fields, Published
from softfuse.hardware.record.session_reader import RecordedSession


@dataclass(frozen=True)
class Comparison:
    """How the estimates of a replay compare with the recorded ones.

    `recorded`: in the file; `identical`: those whose every number came again to the last bit; `first`: the
    frame of the first one that did not, None without any.
    """

    recorded: int
    identical: int
    first: int | None

    def words(self, estimates: int) -> str:
        """In words, for so many estimates made again."""
        if not self.recorded:
            return f"{estimates} estimates; the session holds none to compare with"
        same = f"{self.identical} of {self.recorded} estimates are the recorded ones to the last bit"
        return same if self.first is None else f"{same}; the first other one is at frame {self.first}"


class Replay:
    """Replays one session; made for one run."""

    def __init__(
        self,
        recorded: RecordedSession,
        pipeline: Pipeline,
        estimating: Estimating,
    ):
        """`pipeline`: like that of the recording, with new drivers, or with none where the session has no
        bytes but all its channels; `estimating`: one that has seen nothing.
        """
        self._recorded, self._pipeline, self._estimating = recorded, pipeline, estimating
        self._wanted = {entry.frame: entry for entry in recorded.estimates()}
        self._ends = sorted(self._wanted)
        self._identical = 0
        self._first: int | None = None

    @property
    def comparison(self) -> Comparison:
        """How what has been replayed so far compares."""
        return Comparison(len(self._wanted), self._identical, self._first)

    def run(self, speed: float = math.inf) -> Iterator[Published]:
        """The estimates, in order; `speed` [-]: of the recorded time, infinity for as fast as possible."""
        for estimate in self._estimating.follow(self._paced(speed)):
            yield self._published(estimate)

    def _paced(self, speed: float) -> Iterator[tuple[Frame, bool]]:
        """The frames that went into estimates, each when it is its turn, and whether one was made of it."""
        start_s, first_s, began = None, 0.0, 0.0
        for number, frame in enumerate(self._frames()):
            if start_s is None:
                start_s, first_s, began = frame.time_s, frame.arrived_s, time.monotonic()
            due = began + (frame.arrived_s - first_s) / speed
            time.sleep(max(0.0, due - time.monotonic()))
            if self._went_in(number):
                self._last = number, frame
                wanted = number in self._wanted or not self._wanted
                yield Frame(frame.time_s - start_s, frame.values), wanted

    def _went_in(self, number: int) -> bool:
        """Whether a frame went into an estimate, or none came after it that could tell."""
        following = bisect_left(self._ends, number)
        if following == len(self._ends):
            return True
        entry = self._wanted[self._ends[following]]
        return entry.sensed is None or number > entry.frame - entry.sensed

    def _published(self, estimate: Estimate) -> Published:
        number, frame = self._last
        tracked, fields = estimate.tracked, self._estimating.fields(estimate)
        recorded = self._wanted.get(number)
        if recorded is not None:
            statuses = tuple(str(status) for status in tracked.statuses)
            # A session holds what was estimated when it was recorded, which may be less.
            then = {name: fields.get(name) for name in self._recorded.info.estimates}
            if _known(then) == _known(recorded.fields) and statuses == recorded.status:
                self._identical += 1
            elif self._first is None:
                self._first = number
        channels = dict(zip(self._pipeline.wanted, frame.values.tolist(), strict=True))
        return Published(number, frame.time_s, channels, estimate, fields, tracked.latency_s)

    def _frames(self) -> Iterator[Assembled]:
        """Frames out of the recorded bytes, or as they are where a session has none, as converted ones do."""
        info = self._recorded.info
        if not info.sources:
            take = [info.channels.index(name) for name in self._pipeline.wanted]
            for entry in self._recorded.frames():
                yield Assembled(entry.time_s, entry.values[take], entry.time_s)
            return
        for chunk in self._recorded.chunks():
            frames, _ = self._pipeline.feed(chunk)
            yield from frames


def _known(fields: Fields) -> dict[str, float | str]:
    return {
        name: value
        for name, value in fields.items()
        if value not in (None, "") and not (isinstance(value, float) and not math.isfinite(value))
    }
