"""The pose of an electrode array, fitted to places that are known."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.calibration.array_pose import Located, PoseFit, PosePrior, fit_pose
from softfuse.sensors.crossed.sensor import ArrayPose
from softfuse.sensors.crossed.settings import PoseSettings

PRIOR = PosePrior(0.5e-3, 0.02, 0.01, 0.5, 0.1)
AREA = 1e-3 * np.array([(x, y) for x in (-28.0, 0.0, 28.0) for y in (-28.0, 0.0, 28.0)])
POSE = np.array([0.3e-3, -0.2e-3, 0.01, 0.004, -0.006])
SIGMA = 0.05e-3


DENT = 1e-3 * np.array([0.5, 1.5, 3.0])


def pressed(rng: np.random.Generator, presses: int, spread: float, part: float = 0.0) -> Located:
    """Three samples a press, alike, off by `spread` of what is promised, and by a part of their dents."""
    location = np.repeat(rng.uniform(-0.028, 0.028, (presses, 2)), 3, axis=0)
    shift, turn, stretch = POSE[:2], POSE[2], np.exp(POSE[3:])
    pose = ArrayPose(*map(jnp.asarray, (shift, turn, stretch, 1.0, 0.0)))
    true = np.array([pose.on_body(each) for each in jnp.asarray(location)])
    alike = np.repeat(rng.normal(size=(presses, 2)), 3, axis=0)
    own = rng.normal(size=location.shape)
    dent = np.tile(DENT, presses)
    off = np.hypot(spread * SIGMA, part * dent)[:, None] * (np.sqrt(0.8) * alike + np.sqrt(0.2) * own)
    sigma, press = np.full(location.shape, SIGMA), np.repeat(np.arange(presses), 3)
    return Located(true + off, location, sigma, dent, press)


@pytest.mark.slow
def test_a_spread_that_grows_with_dents_is_told_from_one_that_does_not() -> None:
    rng = np.random.default_rng(6)
    flat, dented = (
        [fit_pose(pressed(rng, 12, 1.0, part), PRIOR, AREA).dent_part for _ in range(20)]
        for part in (0.0, 0.1)
    )
    assert np.median(flat) < 0.01
    assert 0.07 < np.median(dented) < 0.13


def test_a_pose_is_found_within_its_interval_and_so_is_the_spread() -> None:
    rng = np.random.default_rng(2)
    off, factors = [], []
    for _ in range(60):
        found = fit_pose(pressed(rng, 8, 1.5), PRIOR, AREA)
        off.append((found.value - POSE) / found.sigma)
        factors.append(found.factor)
    off = np.array(off)
    # 300 numbers, of which a tenth should lie outside.
    assert 0.84 < np.mean(np.abs(off) < 1.645) < 0.96
    # With what is not known of the pose, more than 1.5.
    assert 1.4 < np.median(factors) < 2.2


def test_locations_are_nearer_and_the_interval_of_others_holds_the_truth() -> None:
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(40):
        found = fit_pose(pressed(rng, 5, 0.7), PRIOR, AREA)
        assert np.linalg.norm(found.after_m) < 0.5 * np.linalg.norm(found.before_m)
        others = pressed(rng, 30, 0.7)
        left = others.place_m - others.location_m - others.slope @ found.value
        inside.append(np.abs(left) < 1.645 * found.factor * SIGMA)
    assert 0.85 < np.mean(inside) < 0.97


def test_what_nothing_explains_lets_go() -> None:
    rng = np.random.default_rng(4)
    located = pressed(rng, 10, 0.5)
    wrong = located.place_m + np.where(located.press == 3, 3e-3, 0.0)[:, None]
    found = fit_pose(replace(located, place_m=wrong), PRIOR, AREA)
    assert np.abs(found.value[:2] - POSE[:2]).max() < 0.15e-3


def test_priors_of_0_leave_the_array_where_it_is_drawn() -> None:
    found = fit_pose(pressed(np.random.default_rng(5), 6, 1.0), PosePrior(0.0, 0.0, 0.0, 0.5, 0.0), AREA)
    assert isinstance(found, PoseFit) and np.abs(found.value).max() < 1e-9
    np.testing.assert_allclose(found.after_m, found.before_m, atol=1e-9)
    assert found.factor > 3.0


def test_a_pose_turns_and_stretches_places_and_their_spread() -> None:
    pose = ArrayPose(*map(jnp.asarray, ([1e-3, 2e-3], np.pi / 2, [1.1, 0.9], 2.0, 0.1)))
    at = pose.on_body(jnp.array([0.01, 0.02]))
    np.testing.assert_allclose(at, [1e-3 - 0.018, 2e-3 + 0.011], atol=1e-12)
    promised = 4 * np.diag([0.81 * 4, 1.21])
    for widening, dent, spread in (
        (1.0, 0.0, promised),
        (1.0, 3.0, promised + 0.01 * 9.0 * np.eye(2)),
        (3.0, 0.0, promised),
        (5.0, 3.0, 5.0 / 4.0 * promised),
        (5.0, 100.0, promised + 100.0 * np.eye(2)),
    ):
        found = pose.spread(widening * jnp.diag(jnp.array([1.0, 4.0])), *map(jnp.asarray, (widening, dent)))
        np.testing.assert_allclose(found, spread, atol=1e-12)
    drawn = PoseSettings().pose()
    assert drawn.on_body(jnp.array([0.01, -0.02])) == pytest.approx([0.01, -0.02])
