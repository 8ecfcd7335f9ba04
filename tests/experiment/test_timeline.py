"""Episodes in time: rests, ways, holds and samples, through equilibria that are made up."""

import numpy as np
import pytest

from softfuse.experiment.pose_cache import Arrays
from softfuse.experiment.timeline import Frames, Timing, frames

GAPS = np.array([20e-3, 5e-3, 1e-3, 0.0])
TIMING = Timing(rest_s=2.0, drive_s=1.0, settle_s=0.5, travel_s=0.4, hold_s=1.0, press_s=2.0, release_s=1.5)


def press(driven: int = 0, most: float = 6.0) -> Arrays:
    """Volume goes with force, a signal with the gap; a drive in so many steps before."""
    force = np.concatenate([np.zeros(driven + 4), np.array([1.0, 3.0, 6.0]) * most / 6])
    gap = np.concatenate([np.full(driven, GAPS[0]), GAPS, [-1e-4, -3e-4, -6e-4]])
    drive = np.concatenate([np.linspace(0, 1, driven + 1), np.ones(len(force) - driven - 1)]) * bool(driven)
    return {
        "force": force[:, None],
        "gap": gap[:, None],
        "reading": -1e-8 * force[:, None] * np.array([1.0, 0.5]),
        "signal eye": np.exp(-np.maximum(gap, 0.0) / 2e-3)[:, None, None],
        "drive": drive[:, None],
        "held": (force > 0).astype(float),
    }


def posing() -> Arrays:
    """Nothing touches."""
    n = 5
    return {
        "force": np.zeros((n, 1)),
        "gap": np.full((n, 1), GAPS[0]),
        "reading": np.zeros((n, 2)),
        "signal eye": np.zeros((n, 1, 1)),
        "drive": np.linspace(0, 1, n)[:, None],
        "held": np.array([0.0, 0, 0, 0, 1]),
    }


@pytest.fixture(scope="module")
def rows() -> Frames:
    return frames([press(), press(4, 3.0), posing()], TIMING)


def test_an_episode_takes_its_time(rows: Frames) -> None:
    one = 2.0 + 1.0 + 2.0 + 3.0 + 1.5 + 1.0 + 0.4
    assert rows.time_s[-1] == pytest.approx(
        one + (one + 1.0 + 0.5 + 1.0) + (2.0 + 1.0 + 0.5 + 1.0 + 0.4), abs=0.1
    )
    np.testing.assert_allclose(np.diff(rows.time_s), 0.01, rtol=1e-6)
    assert set(np.unique(rows.episode)) == {0, 1, 2} and (np.diff(rows.episode) >= 0).all()


def test_samples_are_in_the_middle_of_holds(rows: Frames) -> None:
    at = np.flatnonzero(rows.sample)
    assert rows.sample[at].tolist() == [1, 2, 3, 1, 2, 3, 1]
    force, drive = rows.values["force"][:, 0], rows.values["drive"][:, 0]
    np.testing.assert_allclose(force[at], [1, 3, 6, 0.5, 1.5, 3, 0], atol=1e-12)
    np.testing.assert_allclose(drive[at], [0, 0, 0, 1, 1, 1, 1], atol=1e-12)
    for row in at[:-1]:
        np.testing.assert_allclose(force[row - 45 : row + 45], force[row], atol=1e-12)


def test_values_pass_through_the_equilibria_and_end_as_they_began(rows: Frames) -> None:
    force, volume = rows.values["force"][:, 0], rows.values["reading"]
    np.testing.assert_allclose(volume, -1e-8 * force[:, None] * [1.0, 0.5], atol=1e-15)
    assert rows.values["signal eye"].shape == (len(rows.time_s), 1, 1)
    gap, eye = rows.values["gap"][:, 0], rows.values["signal eye"][:, 0, 0]
    for height in GAPS[1:-1]:
        near = np.abs(gap - height) < 1e-4
        assert near.any() and np.abs(eye[near] / np.exp(-height / 2e-3) - 1).max() < 0.06
    for name in ("force", "drive", "reading"):
        assert np.abs(rows.values[name][-1] - rows.values[name][0]).max() < 1e-9
    assert gap.max() == pytest.approx(20e-3) and (gap[:190] == gap[0]).all()


def test_nothing_jumps(rows: Frames) -> None:
    for name, largest in (("force", 0.1), ("drive", 0.02), ("gap", 0.5e-3), ("reading", 1e-9)):
        assert np.abs(np.diff(rows.values[name], axis=0)).max() < largest


def test_depths_alone_carry_a_press_on() -> None:
    """As those of rigid tips do, whose force may stay where it is."""
    poses = dict(press())
    poses["force"] = np.minimum(poses["force"], 3.0)
    found = frames([poses], TIMING)
    at = np.flatnonzero(found.sample)
    np.testing.assert_allclose(found.values["gap"][at, 0], [-1e-4, -3e-4, -6e-4], atol=1e-12)
