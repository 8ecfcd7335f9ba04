"""A stream of frames through a tracker: all are sensed, those that are wanted are estimated and smoothed.

    bytes -> Frame -> Observation -> Tracked -> Smoothed -> columns

Sensors integrate flows and debounce touches and want every frame; forces and shape are asked for as often as
the machine manages. Which frames were estimated is all that it takes to repeat every number.
"""

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from softfuse.estimation.smoothing.smoother import Smoothed, Smoother
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.mechanics.solution import State


class Estimate(NamedTuple):
    """What is known after a frame: alone, with those before, None where nothing touches or they say nothing
    of forces together, and the state of the body and its loads.
    """

    tracked: Tracked
    smoothed: Smoothed | None
    state: State


def follow(
    tracker: Tracker, frames: Iterable[tuple[Frame, bool]], smoother: Smoother | None = None
) -> Iterator[Estimate]:
    """The estimates of those frames that are wanted, in order; without a smoother nothing is smoothed.

    `frames`: each frame, and whether it is wanted. The next is asked for once an estimate is dealt with.
    """
    for frame, wanted in frames:
        started = time.perf_counter()
        finding = tracker.sense(frame)
        if wanted:
            tracked = tracker.estimate(frame.time_s, finding)
            tracked = replace(tracked, latency_s=time.perf_counter() - started)
            yield Estimate(tracked, _smoothed(smoother, tracked), tracker.state)


def smoother_of(tracker: Tracker) -> Smoother | None:
    """What smooths the frames of a tracker; None where no reading drifts, as a frame tells all there is."""
    return None if tracker.drift is None else Smoother.of(tracker)


def _smoothed(smoother: Smoother | None, tracked: Tracked) -> Smoothed | None:
    if smoother is None:
        return None
    found = smoother.update(tracked)
    return found if tracked.contacts and np.isfinite(found.force_N) else None
