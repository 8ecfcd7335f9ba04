"""Frames of a real recording's sensors, healthy and not, through the tracker of a small body.

The body is not the one of the recording: its two chambers stand for two of that one's. What is tested is what
is said about a frame, not how right the force is.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from compilations import compilations
from made_robots import BLOCK, settings_of

from softfuse.estimation.doubts import TrackerSettings
from softfuse.estimation.model_error import ModelError
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.hardware.recording import read_recording
from softfuse.mechanics.dense import Dense
from softfuse.robot.robot import build_robot
from softfuse.sensors.status import Status

DATA = Path(__file__).parents[1] / "data"
TRUSTING = TrackerSettings(poor_fit=1e6)
AT = ["-28 mm", "-20 mm", "-12 mm", "-4 mm", "4 mm", "12 mm", "20 mm", "28 mm"]
LINES = f"""
[[sensor]]
name = "electrodes"
type = "crossed-diamonds"
contact = "stage"
row_y = {AT}
column_x = {AT}
row_depth = "1.5 mm"
column_depth = "1.0 mm"
channels = {[f"{name}{k}" for name in ("row", "col") for k in range(8)]}
"""
VENTS = slice(0, 2)


def _tracker(reach_m: float) -> Tracker:
    """A tracker whose workspace reaches so far from the middle."""
    reach = f'["{-reach_m} m", "{reach_m} m"]'
    settings = settings_of(
        BLOCK[: BLOCK.rindex("[[sensor]]")] + LINES,
        ("[body.source]", '[body]\nelement = "linear"\n\n[body.source]'),
        # With a high Poisson's ratio linear elements lock.
        ("poisson = 0.49", "poisson = 0.3"),
        # The cells of a punch are smaller than the triangles of this mesh.
        ('model = "punch"', 'model = "uniform"'),
        ('radius = "8 mm"', 'radius = "10 mm"'),
        ('max_force = "10 N"', 'max_force = "25 N"'),
        ('x = ["-25 mm", "25 mm"], y = ["-11 mm", "11 mm"]', f"x = {reach}, y = {reach}"),
        ('channels = ["flow0_V", "flow1_V"]', 'channels = ["flow1_V", "flow2_V"]'),
    )
    robot = build_robot(settings)
    # Small as it is, a dense solver compiles soonest.
    model = replace(robot.model, linear=Dense.plan(robot.model.body))
    return Tracker(replace(robot, model=model), settings=TRUSTING)


@pytest.fixture(scope="module")
def tracker() -> Tracker:
    return _tracker(0.1)


@pytest.fixture(scope="module")
def frames(tracker: Tracker) -> list[Frame]:
    """The first press up to the first force level, at (21.8, −3.1) mm."""
    recording = read_recording(DATA / "pad_nominal_two_presses.csv.gz", [])
    raw = recording.matrix(tracker.robot.suite.channels)
    return [Frame(*each) for each in zip(recording.time_s[:260].tolist(), raw[:260], strict=True)]


@pytest.fixture(scope="module")
def run(tracker: Tracker, frames: list[Frame]) -> Callable[..., list[Tracked]]:
    """run(flow=..., settings=...): all frames anew, with other volts or other settings."""

    def go(flow: Callable = lambda i, volts: volts, settings: TrackerSettings = TRUSTING) -> list[Tracked]:
        tracker.reset()
        tracker.settings = settings
        found = []
        for i, frame in enumerate(frames):
            raw = frame.raw.copy()
            raw[VENTS] = flow(i, raw[VENTS])
            found.append(tracker.update(Frame(frame.time_s, raw)))
        return found

    return go


def test_contact_begins_and_is_located(run) -> None:
    found = run()
    assert found[0].statuses == (Status.no_contact,) and found[0].contacts == 0
    assert found[0].force_N == 0.0 and np.all(np.isnan(found[0].centre_m))
    last = found[-1]
    assert last.contacts == 1 and last.statuses == (Status.ok,)
    assert 0 < last.force_N < 25
    np.testing.assert_allclose(last.centre_m[:2], [21.78e-3, -3.11e-3], atol=0.3e-3)
    assert np.isfinite(last.residual)


def test_nothing_is_compiled_from_the_first_frame_on(frames: list[Frame]) -> None:
    jax.clear_caches()
    fresh = _tracker(0.1)
    # Where presses would be looked for is prepared beside the frames.
    with compilations(beside=False) as events:
        touched = [fresh.update(frame).contacts for frame in frames]
    assert events == [] and set(touched) == {0, 1}


def test_a_contact_outside_the_workspace_has_a_place_but_no_force(frames: list[Frame]) -> None:
    narrow = _tracker(0.01)
    last = [narrow.update(frame) for frame in frames][-1]
    assert Status.outside in last.statuses and np.isnan(last.force_N)
    assert np.all(np.isfinite(last.centre_m)) and np.isnan(last.residual)


def test_a_force_at_the_limit_is_flagged(run) -> None:
    found = run(flow=lambda i, volts: 0.5 + 8 * (volts - 0.5) if i > 120 else volts)
    limited = [row for row in found if Status.force_limit in row.statuses]
    assert len(limited) > 50
    np.testing.assert_allclose([row.force_N for row in limited], 25.0, rtol=1e-9)
    assert max(row.force_N for row in found) < 25.0 * (1 + 1e-9)


def test_volumes_that_no_force_explains_are_doubted(run) -> None:
    found = run(settings=TrackerSettings(poor_fit=0.01))
    assert Status.poor_fit in found[-1].statuses


def test_without_flow_there_is_no_force(run) -> None:
    found = run(flow=lambda i, volts: volts if i < 160 else np.full(2, np.nan))
    assert "flow missing" in found[-1].statuses and Status.nothing_measured in found[-1].statuses
    assert np.isnan(found[-1].force_N) and found[-1].contacts == 1


def test_the_same_frames_give_the_same_numbers(run) -> None:
    first, second = run(), run()
    assert [row.force_N for row in first] == [row.force_N for row in second]


def test_evidence_says_how_readings_go_with_places_that_they_tell(run: Callable[..., list[Tracked]]) -> None:
    # Of a model about whose errors nothing is known, readings tell no place.
    known, told = (
        run(settings=TrackerSettings(poor_fit=1e6, model_error=error))[-1]
        for error in (None, ModelError(0.1))
    )
    assert known.evidence is not None and told.evidence is not None
    assert known.evidence.by_place.shape == told.evidence.by_place.shape and told.evidence.by_place.size
    assert not known.evidence.by_place.any() and told.evidence.by_place.all()
    seen = known.location_m[:, :2].ravel()
    for found in (known, told):
        np.testing.assert_array_equal(found.evidence.seen_m, seen)
        np.testing.assert_allclose(found.evidence.place_m, found.location_m[:, :2].ravel(), atol=1e-12)
    assert np.all(told.evidence.place_m != seen)
    np.testing.assert_array_equal(told.evidence.seen_sigma_m, known.location_sigma_m.ravel())
