"""A bounded queue between the thread that makes frames and the one that estimates.

When it is full the oldest frame goes, counted: an estimate of now is worth more than one of a second ago.
Only the estimator loses it, recorders have it already.
"""

import threading
from collections import deque

from softfuse.hardware.live.assembler import Assembled


class FrameQueue:
    """Frames that wait for the estimator, with their numbers."""

    def __init__(self, length: int):
        """`length`: how many frames may wait."""
        self._frames: deque[tuple[int, Assembled]] = deque()
        self._length = length
        self._changed = threading.Condition()
        self._closed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Frames that the estimator never saw."""
        return self._dropped

    @property
    def waiting(self) -> int:
        """Frames that wait now."""
        return len(self._frames)

    def put(self, number: int, frame: Assembled) -> None:
        """Append a frame; never blocks."""
        with self._changed:
            if len(self._frames) >= self._length:
                self._frames.popleft()
                self._dropped += 1
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
