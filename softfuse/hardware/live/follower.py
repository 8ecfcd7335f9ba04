"""A tracker behind the frames of a pipeline: every frame is sensed, the last of a batch is estimated.

Senses integrate flows and debounce touches and want every frame; forces and shape are asked for as often as
the machine manages. Which frames were estimated is all that replaying needs to repeat every number.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from softfuse.equilibrium.solution import State
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.hardware.live.assembler import Assembled

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
        self, tracker: Tracker, groups: Sequence[ChannelGroup], read: Callable[[Tracked, State], Fields]
    ):
        """`groups`: those of the tracker's senses, whose names in this order are a frame's channels; `read`:
        what people read of an estimate and the state that it leaves the device in.
        """
        self.tracker, self._read = tracker, read
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

    def estimate(self) -> tuple[Tracked, Fields]:
        """Forces and shape at the last frame that was seen, and what people read of them."""
        tracked = self.tracker.estimate(self._time_s, self._sensed)
        return tracked, self._read(tracked, self.tracker.state)
