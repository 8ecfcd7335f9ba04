"""A tracker behind the frames of a pipeline: every frame is sensed, the last of a batch is estimated, and
joined with those before.

Senses integrate flows and debounce touches and want every frame; forces and shape are asked for as often as
the machine manages. Which frames were estimated is all that replaying needs to repeat every number.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.fusion.fusion import Fused, Fusion
from softfuse.hardware.live.assembler import Assembled
from softfuse.mechanics.solution import State

Fields = Mapping[str, float | str | None]
"""What people read of an estimate, by the columns' names."""


@dataclass(frozen=True)
class ChannelGroup:
    """Channels that senses want side by side: their names, and what turns them into its unit."""

    names: tuple[str, ...]
    unit: float


class Follower:
    """Advances a tracker by frames of all channels."""

    def __init__(
        self,
        tracker: Tracker,
        groups: Sequence[ChannelGroup],
        fusion: Fusion | None,
        read: Callable[[Tracked, Fused | None, State], Fields],
    ):
        """`groups`: those of the tracker's senses, whose names in this order are a frame's channels;
        `fusion`: what joins estimates, if they are to be; `read`: what people read of an estimate, of what
        it says together with those before, and of the state that it leaves the device in.
        """
        self.tracker, self._fusion, self._read = tracker, fusion, read
        self._ends: list[tuple[int, int, float]] = []
        start = 0
        for group in groups:
            self._ends.append((start, start + len(group.names), group.unit))
            start += len(group.names)

    def sense(self, frame: Assembled, start_s: float) -> None:
        """See a frame; times count from `start_s` [s since the epoch]."""
        readings = tuple(unit * frame.values[a:b] for a, b, unit in self._ends)
        self._time_s = frame.time_s - start_s
        self._sensed = self.tracker.sense(Frame(self._time_s, readings))

    def estimate(self) -> tuple[Tracked, Fused | None, Fields]:
        """Forces and shape at the last frame that was seen, what it says together with those before, None
        where nothing touches or it says nothing of forces, and what people read of all this.
        """
        tracked = self.tracker.estimate(self._time_s, self._sensed)
        joined = self._joined(tracked)
        return tracked, joined, self._read(tracked, joined, self.tracker.state)

    def _joined(self, tracked: Tracked) -> Fused | None:
        if self._fusion is None:
            return None
        fused = self._fusion.update(tracked)
        return fused if tracked.contacts and np.isfinite(fused.force_N) else None
