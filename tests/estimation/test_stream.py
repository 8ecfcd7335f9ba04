"""The one function that follows frames: which are sensed, estimated and smoothed, and in what order."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from checks import stand_in

from softfuse.estimation.stream import follow, smoother_of
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.sensors.status import Status


class Tracker:
    """Notes what it is asked, in order; something touches in frames with a positive reading."""

    def __init__(self):
        self.asked: list[str] = []
        self.drift = None
        self.state: Any = None

    def sense(self, frame: Frame) -> Frame:
        self.asked.append(f"sense {frame.time_s:g}")
        return frame

    def estimate(self, time_s: float, finding: Frame) -> Tracked:
        self.asked.append(f"estimate {time_s:g}")
        self.state = f"state {time_s:g}"
        touching, nothing = finding.raw > 0, np.zeros(1)
        return Tracked(
            time_s,
            *(touching, np.zeros((1, 3)), np.zeros((1, 2)), finding.raw, np.eye(1), np.zeros((1, 3, 3))),
            *(np.eye(1), np.zeros(0), nothing, nothing, touching, nothing, None, {}, (Status.ok,), 0.0),
        )


class Smoother:
    """Halves forces; knows nothing of the frame at 3 s."""

    def update(self, now: Tracked) -> Any:
        force = np.nan if now.time_s == 3 else 0.5 * now.force_N
        return stand_in(force_N=force)


FRAMES = [(Frame(float(k), np.array([float(k > 1)])), k != 1) for k in range(5)]


def test_every_frame_is_sensed_and_those_that_are_wanted_estimated() -> None:
    tracker: Any = Tracker()
    estimates = [*follow(tracker, FRAMES)]
    assert [now.tracked.time_s for now in estimates] == [0, 2, 3, 4]
    assert tracker.asked == [
        *("sense 0", "estimate 0", "sense 1", "sense 2", "estimate 2"),
        *("sense 3", "estimate 3", "sense 4", "estimate 4"),
    ]
    assert [now.state for now in estimates] == ["state 0", "state 2", "state 3", "state 4"]
    assert all(now.smoothed is None and now.tracked.latency_s > 0 for now in estimates)


def test_the_next_frame_is_asked_for_when_an_estimate_was_dealt_with() -> None:
    tracker: Any = Tracker()
    stream = follow(tracker, FRAMES)
    next(stream)
    assert tracker.asked == ["sense 0", "estimate 0"]


def test_estimates_are_smoothed_where_something_touches_and_forces_are_known() -> None:
    tracker, smoother = Tracker(), Smoother()
    found = [now.smoothed for now in follow(tracker, FRAMES, smoother)]  # type: ignore[arg-type]
    assert found[0] is None and found[2] is None
    assert [each.force_N for each in found if each is not None] == [0.5, 0.5]


def test_what_does_not_drift_is_not_smoothed() -> None:
    tracker: Any = Tracker()
    assert smoother_of(tracker) is None


@pytest.mark.parametrize("inverted", [False, True])
def test_residuals_are_in_standard_deviations(inverted: bool) -> None:
    now = Tracker().estimate(0.0, FRAMES[2][0])
    several = replace(now, misfit=np.array([2e-9, np.nan, 300.0]), sigma=np.array([1e-9, 1.0, 100.0]))
    if inverted:
        several = replace(several, misfit=np.full(3, np.nan))
        assert np.isnan(several.residual)
    else:
        assert several.residual == pytest.approx(np.sqrt((4 + 9) / 2))
