"""Something that electrodes do not see presses the pad of the recording: found by the cavities alone.

The flow is the recording's; the electrodes stay as they were before the touch.
"""

from pathlib import Path

import numpy as np
import pytest
from compilations import compilations

from softfuse.estimation.tracked import Frame, Tracked
from softfuse.estimation.tracker import Tracker
from softfuse.hardware.recording import read_recording
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.sensors.status import Status

ROOT = Path(__file__).parents[2]
COARSE = (
    ('surface_size = "12 mm"', 'surface_size = "20 mm"'),
    ('base_size = "12 mm"', 'base_size = "20 mm"'),
    ('fine_depth = "3 mm"', 'fine_depth = "0 mm"'),
)
EVERY = 4


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Tracked], np.ndarray]:
    """Every fourth frame of two presses, at (21.8, −3.1) and (−3.1, 3.1) mm, and where and how hard they
    are: x, y [mm], force [N]; nothing is compiled meanwhile.
    """
    text = (ROOT / "configs" / "pad.toml").read_text(encoding="utf-8")
    for old, new in COARSE:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("config") / "coarse.toml"
    path.write_text(text, encoding="utf-8")
    tracker = Tracker(build_robot(load(path)))
    recording = read_recording(ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz", [])
    flow = recording.matrix([f"flow{k}_V" for k in range(4)])
    counts = recording.matrix([f"{name}{k}" for name in ("row", "col") for k in range(8)])
    truth = recording.matrix(["true_x_mm", "true_y_mm", "true_force_N"])
    still = np.round(counts[0] + np.random.default_rng(1).normal(0, 8, counts.shape))
    rows, true = [], []
    # What presses all over the pad do is prepared beside the frames.
    with compilations(beside=False) as events:
        for k, (at, volts, seen) in enumerate(zip(recording.time_s, flow, still, strict=True)):
            sensed = tracker.sense(Frame(at, np.concatenate([volts, seen])))
            if k % EVERY == 0:
                rows.append(tracker.estimate(at, sensed))
                true.append(truth[k])
    assert events == []
    return rows, np.array(true)


@pytest.mark.parametrize("press", [(21.8, -3.1), (-3.1, 3.1)])
def test_it_is_found_by_the_cavities_with_an_honest_sigma(found, press: tuple[float, float]) -> None:
    rows, true = found
    firm = (true[:, 2] > 4.0) & (np.linalg.norm(true[:, :2] - press, axis=1) < 0.1)
    assert firm.sum() > 30
    place = np.array([1e3 * row.location_m[0, :2] for row in rows])[firm]
    off = np.linalg.norm(place - true[firm, :2], axis=1)
    assert np.median(off) < 2.5
    sigma = np.array([1e3 * row.location_sigma_m[0] for row in rows])[firm]
    assert np.all(np.isfinite(sigma)) and np.median(sigma) > 0.1
    ratio = (place - true[firm, :2]) / sigma
    assert np.mean(np.abs(ratio) < 2.6) > 0.9
    force, force_sigma = (
        np.array([getattr(row, name) for row in rows])[firm] for name in ("force_N", "force_sigma_N")
    )
    assert np.mean(np.abs(force - true[firm, 2]) < 2.6 * force_sigma) > 0.9


def test_what_is_not_seen_is_said(found) -> None:
    rows, true = found
    pressed = true[:, 2] > 1.0
    said = np.array([Status.unseen in row.statuses for row in rows])
    assert said[pressed].mean() > 0.95
    assert not said[:20].any()


def test_the_touch_ends_when_it_is_released(found) -> None:
    rows, true = found
    presses = np.flatnonzero(true[:, 2] > 1.0)
    between = presses[0] + np.flatnonzero(true[presses[0] : presses[-1], 2] == 0.0)
    # The last third of the pause.
    late = between[-len(between) // 3 :]
    assert len(late) > 5
    assert all(rows[k].contacts == 0 and rows[k].force_N == 0.0 for k in late)
