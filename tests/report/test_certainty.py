"""Which further presses are looked at."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from checks import stand_in

from softfuse.calibration.of_robot import Fitted
from softfuse.calibration.robust import Discrepancy
from softfuse.errors import ConfigError
from softfuse.functional.workspace import spread_out
from softfuse.report.certainty import error_edits, least_and_most
from softfuse.robot.file import load, save_edited
from softfuse.robot.settings import RobotSettings

CONFIGS = Path(__file__).parents[2] / "configs"


def named(settings: RobotSettings, sensors: Mapping[str, int]) -> Fitted:
    """A robot known by its settings and sensors only, with so many readings each."""
    robot = stand_in(settings=settings, addresses=stand_in(readings=sensors))
    kind = np.repeat(np.arange(len(sensors)), list(sensors.values()))
    return Fitted(robot, stand_in(), np.arange(len(kind)), kind, (), np.zeros(0, bool))


def test_actuators_are_as_they_were_in_one_sample() -> None:
    prescribed = np.array(
        [[0.0, 101325.0, 0.0], [2.0, 101325.0, 0.0], [0.0, 101325.0, 9e3], [1.0, 101325.0, 8e3]]
    )
    # All three at their largest is a pose that nobody has tried.
    assert least_and_most(prescribed).tolist() == [0, 3]


def test_one_sample_says_all_where_nothing_moves() -> None:
    assert least_and_most(np.full((4, 2), 101325.0)).tolist() == [0]
    assert least_and_most(np.zeros((3, 0))).tolist() == [0]


def test_places_are_looked_at_far_apart() -> None:
    """Of a row the ends come first, then the middle."""
    row = np.linspace(0.0, 1.0, 9)[:, None] * np.array([1.0, 2.0, 0.0])
    assert spread_out(row, most=3).tolist() == [0, 8, 4]
    assert sorted(spread_out(row, most=20).tolist()) == list(range(9))


def test_the_model_error_that_presses_tell_is_counted_once(tmp_path: Path) -> None:
    """A sealed pad's own guess of 5 % of each pressure beside the 2 % that were found made forces as unsure
    as if nobody had calibrated it.
    """
    drawn = load(CONFIGS / "pad_sealed.toml")
    assert drawn.sensors[0].model_error == 0.05
    one = np.ones(4)
    found = Discrepancy(0.019934 * one, 0.0512345 * one)
    edits = error_edits(named(drawn, {"pressure": 4}), found, "fitted.npz")
    (tmp_path / "fitted.npz").touch()
    fitted = save_edited(CONFIGS / "pad_sealed.toml", tmp_path / "fitted.toml", edits)
    assert fitted.sensors[0].model_error == 0.0 and fitted.estimator.model_error == 0.01993
    assert fitted.estimator.model_error_floor == 0.05123
    # Of what sees contacts by itself the error is its own, and a vent's reading has none.
    assert fitted.sensors[1] == drawn.sensors[1]
    assert set(error_edits(named(load(CONFIGS / "pad.toml"), {"flow": 4}), found, "fitted.npz")) == {
        ("estimator", "model_error"),
        ("estimator", "model_error_floor"),
        ("estimator", "reading_spread"),
    }


def test_each_sensor_has_a_model_error_of_its_own(tmp_path: Path) -> None:
    """A barometer whose model was 25 % off made gratings, off by 2 %, count as little."""
    drawn = load(CONFIGS / "pneunet.toml")
    gratings, barometer = (sensor.name for sensor in drawn.sensors)
    part, floor = np.array([0.02, 0.02, 0.25]), np.array([0.01, 0.01, 0.3])
    edits = error_edits(named(drawn, {gratings: 2, barometer: 1}), Discrepancy(part, floor), "fitted.npz")
    (tmp_path / "fitted.npz").touch()
    fitted = save_edited(CONFIGS / "pneunet.toml", tmp_path / "fitted.toml", edits).estimator
    assert fitted.model_error == {gratings: 0.02, barometer: 0.25}
    assert fitted.model_error_floor == {gratings: 0.01, barometer: 0.3}
    again = save_edited(
        tmp_path / "fitted.toml", tmp_path / "again.toml", {("estimator", "model_error"): 0.1}
    )
    assert again.estimator.model_error == 0.1
    with pytest.raises(ConfigError, match='estimator.model_error: there is no sensor "nose"'):
        save_edited(
            tmp_path / "fitted.toml", tmp_path / "again.toml", {("estimator", "model_error"): {"nose": 0.1}}
        )
