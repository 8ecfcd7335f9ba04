"""Frames of a real recording's sensors, healthy and not, through the tracker of a small device.

The device is not the one of the recording: two of its volumes stand for those of the two cavities. What is
tested is what is said about a frame, not how right the force is.
"""

from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import d6f_p0001a1

from softfuse.robot.file import load
from softfuse.config.build_sensors import build_sensors
from softfuse.estimation.model_error import ModelError
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.doubts import TrackerSettings
from softfuse.estimation.tracker import Tracker
from softfuse.functional.workspace import FlatWorkspace
from softfuse.hardware.recording import read_recording
from softfuse.sensors.pad_senses import PadSenses
from softfuse.sensors.status import Status

ROOT = Path(__file__).parents[2]
TRUSTING = TrackerSettings(poor_fit=1e6)


def _tracker(device, limits, reach_m: float) -> Tracker:
    """A tracker whose workspace reaches so far from the middle."""
    sensors = build_sensors(load(ROOT / "configs" / "pad.toml"))
    sensors = eqx.tree_at(lambda s: s.flow, sensors, d6f_p0001a1(2))
    ends = reach_m * np.array([[-1.0, -1.0], [1.0, 1.0]])
    senses = PadSenses(sensors, jnp.asarray(ends))
    return Tracker(senses, device, limits, TRUSTING, workspace=FlatWorkspace(senses.chart, *ends))


@pytest.fixture(scope="module")
def tracker(plain_device, one) -> Tracker:
    return _tracker(plain_device, one, 0.1)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    """The first press up to the first force level, at (21.8, −3.1) mm."""
    recording = read_recording(ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz", [])
    rows, columns = ([f"{name}{k}" for k in range(8)] for name in ("row", "col"))
    parts = (recording.matrix(names)[:260] for names in (["flow1_V", "flow2_V"], rows, columns))
    groups = zip(*parts, strict=True)
    return [Frame(at, readings) for at, readings in zip(recording.time_s[:260], groups, strict=True)]


@pytest.fixture(scope="module")
def run(tracker: Tracker, frames: list[Frame]) -> Callable[..., list[Tracked]]:
    """run(flow=..., settings=...): all frames anew, with other volts or other settings."""

    def go(flow: Callable = lambda i, volts: volts, settings: TrackerSettings = TRUSTING) -> list[Tracked]:
        tracker.reset()
        tracker.settings = settings
        return [
            tracker.update(Frame(f.time_s, (flow(i, f.readings[0]), *f.readings[1:])))
            for i, f in enumerate(frames)
        ]

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


def test_a_contact_outside_the_workspace_has_a_place_but_no_force(plain_device, one, frames) -> None:
    narrow = _tracker(plain_device, one, 0.01)
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
    assert Status.flow_missing in found[-1].statuses and Status.volume_unknown in found[-1].statuses
    assert np.isnan(found[-1].force_N) and found[-1].contacts == 1


def test_the_same_frames_give_the_same_numbers(run) -> None:
    first, second = run(), run()
    assert [row.force_N for row in first] == [row.force_N for row in second]


def test_evidence_says_how_readings_go_with_places_that_they_tell(run: Callable[..., list[Tracked]]) -> None:
    # Of a model about whose errors nothing is known, readings tell no place.
    known, told = (
        run(settings=TrackerSettings(poor_fit=1e6, model_error=ModelError(part)))[-1] for part in (0.0, 0.1)
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
