"""A fit finds what a finger, its cable and its gas were made with, and says what presses cannot tell."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softfuse.calibration.fit import Fit, fit
from softfuse.calibration.of_robot import (
    Fitted,
    adjustments_of_presses,
    build_adjustments,
    calibrated_edits,
)
from softfuse.calibration.presses import Adjustable, Applied, ContactPlaces, Presses
from softfuse.functional.chart import facing
from softfuse.robot.file import load, save_edited
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.cable_length import CableLengthSettings

ATMOSPHERE = 101325.0
NOISE = 3.0
TIP, UPPER = 10, 7  # left electrodes of the last segments
SAMPLES = (
    # electrode, force [N], shortening [m], press
    (0, 0.0, 0.002, 0),
    (0, 0.0, 0.005, 0),
    (0, 0.0, 0.008, 0),
    (TIP, 0.05, 0.0, 1),
    (TIP, 0.10, 0.0, 1),
    (TIP, 0.15, 0.0, 1),
    (UPPER, 0.1, 0.0, 2),
    (UPPER, 0.2, 0.0, 2),
    (UPPER, 0.3, 0.0, 2),
    (TIP, 0.05, 0.006, 3),
    (TIP, 0.10, 0.006, 3),
)
CALLED = {k: str(k) for k in range(4)}


@pytest.fixture(scope="module")
def config(linear_finger: Callable[..., Path]) -> RobotSettings:
    narrow = 'cavity_shift = "0 mm"\ncavity_growth = "0.1 mm"\ncable_compliance = 1.0'
    line = 'compliance = "0.06 mm/N"\nfriction = 0.0'
    changes = (("[estimator]", f"[calibration]\n{narrow}\n\n[estimator]"), ("friction = 0.0", line))
    return load(linear_finger(*changes))


@pytest.fixture(scope="module")
def applied(config: RobotSettings) -> Applied:
    electrode, force, length, press = (np.array(each) for each in zip(*SAMPLES, strict=True))
    filling = np.full((len(press), 6), ATMOSPHERE)
    prescribed = np.concatenate([length[:, None], filling], axis=1)
    places = np.array(list(config.places.values()))
    return Applied(places[electrode][:, None], force[:, None], prescribed, press)


@pytest.fixture(scope="module")
def fitted(config: RobotSettings) -> Fitted:
    return Fitted.of(build_robot(config))


@pytest.fixture(scope="module")
def adjustable(fitted: Fitted, applied: Applied) -> Adjustable:
    may_differ = build_adjustments(fitted)
    return Adjustable(fitted.model, adjustments_of_presses(fitted, may_differ, applied, CALLED))


@pytest.fixture(scope="module")
def made(adjustable: Adjustable) -> np.ndarray:
    """What the robot was made with: drawn from the prior."""
    sigma = np.asarray(adjustable.adjustments.sigma)
    return sigma * np.random.default_rng(3).normal(size=len(sigma)).clip(-1.5, 1.5)


@pytest.fixture(scope="module")
def found(fitted: Fitted, adjustable: Adjustable, applied: Applied, made: np.ndarray) -> Fit:
    reading = adjustable.answer(made, applied).reading
    noise = NOISE * np.random.default_rng(4).normal(size=reading.shape)
    return fit(adjustable, Presses(applied, reading + noise, np.full(reading.shape, NOISE), fitted.kind))


def test_it_has_the_parameters_of_a_finger(adjustable: Adjustable) -> None:
    names = adjustable.adjustments.names
    for name in (
        "stiffness",
        "tip left growth z",
        "base right gain",
        "palm zero",
        "palm compliance",
        "middle left dead volume",
        "place on tip left in press 1",
        "place on upper left in press 2",
    ):
        assert name in names
    assert "place on base palm in press 0" not in names and "layer" not in names


@pytest.mark.slow
def test_slopes_are_those_of_differences(adjustable: Adjustable, applied: Applied, made: np.ndarray) -> None:
    one = Applied(*(getattr(applied, name)[-1:] for name in ("place", "force_N", "prescribed", "press")))
    slope = adjustable.answer(made, one).slope[0]
    names = adjustable.adjustments.names
    sigma = np.asarray(adjustable.adjustments.sigma)
    for name in (
        "stiffness",
        "palm zero",
        "palm compliance",
        "tip left dead volume",
        "tip left growth z",
        "tip left gain",
        "place on tip left in press 3",
    ):
        k = names.index(name)
        ends = [
            adjustable.answer(made + side * 1e-3 * sigma[k] * np.eye(len(made))[k], one).reading[0]
            for side in (-1, 1)
        ]
        change = (ends[1] - ends[0]) / (2e-3 * sigma[k])
        np.testing.assert_allclose(slope[:, k], change, atol=2e-5 * np.abs(slope[:, k]).max())
        assert np.abs(change).max() > 0


def test_a_push_is_named_by_where_it_presses() -> None:
    """Not by where nothing presses yet."""
    electrodes = facing(1e-2 * np.eye(3), (0, 0, -1))
    place, force = electrodes[[[0], [2], [2]]], np.array([[0.0], [0.1], [0.2]])
    done = Applied(place, force, np.zeros((3, 0)), np.zeros(3, int))
    places = ContactPlaces.of(done, {0: "7"}, dict(zip("abc", electrodes, strict=True)), 1e-3)
    assert places.names == ("place on c in press 7",)
    at = [places.arms(np.zeros(1), np.array(press), np.array([0.002])) for press in (0, -1)]
    np.testing.assert_array_equal(at, [[0.002], [0.0]])


def test_of_cables_that_nothing_pulls_nothing_is_fitted(
    fitted: Fitted, adjustable: Adjustable, applied: Applied
) -> None:
    unpulled = replace(applied, prescribed=np.where(applied.prescribed < 1, 1e-5, applied.prescribed))
    names = adjustments_of_presses(fitted, adjustable.adjustments, unpulled, CALLED).names
    assert "palm zero" not in names and "palm compliance" not in names and "stiffness" in names


@pytest.mark.slow
def test_every_parameter_is_within_its_interval(found: Fit, made: np.ndarray) -> None:
    off = found.value - made
    assert np.all(np.abs(off) < 3.5 * found.sigma)
    count = len(made)
    # Within what 99.9 % of chi² of so many parameters are.
    assert off @ np.linalg.solve(found.covariance, off) < count + 3.1 * np.sqrt(2 * count) + 5


@pytest.mark.slow
def test_what_presses_tell_of_a_cable_is_told(found: Fit) -> None:
    told = dict(zip(found.names, found.told, strict=True))
    assert told["palm zero"] > 0.9 and told["palm compliance"] > 0.5 and told["stiffness"] > 0.9
    assert told["place on tip left in press 1"] > 0.5


@pytest.mark.slow
def test_gain_and_dead_volume_of_a_cavity_are_hard_to_tell_apart(found: Fit) -> None:
    a, b = found.names.index("tip left gain"), found.names.index("tip left dead volume")
    assert found.correlation[a, b] > 0.3


@pytest.mark.slow
def test_the_config_that_is_written_is_that_finger(
    config: RobotSettings,
    fitted: Fitted,
    adjustable: Adjustable,
    made: np.ndarray,
    tmp_path: Path,
    applied: Applied,
) -> None:
    edits = calibrated_edits(fitted, adjustable.adjustments, made)
    again = save_edited(config.path, tmp_path / "fitted.toml", edits)
    whole = Fitted.of(build_robot(again))
    names = adjustable.adjustments.names
    # Zeros, gains and places are not of the robot's body.
    done = Applied(applied.place[3:6], applied.force_N[3:6], applied.prescribed[3:6], -1 - np.arange(3))
    none = build_adjustments(whole)
    body = made.copy()
    for k, name in enumerate(names):
        if name.endswith((" gain", " zero")):
            body[k] = 0.0
    there = Adjustable(whole.model, none).answer(np.zeros(len(none.names)), done).reading
    np.testing.assert_allclose(there, adjustable.answer(body, done).reading, rtol=1e-4, atol=0.05)
    (cable,) = again.sensors_of(CableLengthSettings)
    zero = made[names.index("palm zero")]
    np.testing.assert_allclose(cable.zero, [zero], atol=1e-9)
    assert again.cables[0].compliance > 0
