"""Fitted parameters become settings whose robot is the fitted one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_robots import BEAM, settings_of

from softfuse.calibration.of_robot import Fitted, build_adjustments, calibrated_edits
from softfuse.errors import ConfigError
from softfuse.mechanics.cable import ShortenedCable
from softfuse.robot.file import load, save_edited
from softfuse.robot.robot import build_robot
from softfuse.sensors.point_pressure import PointPressureSettings

Write = Callable[..., Path]

BAROMETER = """
[[sensor]]
name = "barometer"
type = "point-pressure"
point = "tip"
radius = "0.5 mm"
channels = ["barometer_Pa"]
"""


@pytest.fixture
def write(coarse: Path, tmp_path: Path) -> Write:
    """Writes the coarse pad with pieces of its text replaced: write((old, new), ...)."""

    def written(*changes: tuple[str, str]) -> Path:
        text = coarse.read_text(encoding="utf-8")
        for old, new in changes:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


YEOH = (
    'law = "neo-hookean"\nyoung = "0.6 MPa"                               '
    "# Dragon Skin 30; fit it to presses of known force\npoisson = 0.49",
    'law = "yeoh"\nc1 = "92 kPa"\nc2 = "9 kPa"\nc3 = "-0.4 kPa"\nbulk = "9 MPa"',
)
FIELD = (
    ("[body.fixed] ", "[body.stiffness_field]\nx = 0.02\nyz = -0.03\n\n[body.fixed] "),
    ("[estimator]", "[calibration]\nstiffness_field = 0.1\n[estimator]"),
)
STIFF_ONLY = (
    ("[estimator]", "[calibration]\nstiffening = 0\n[estimator]"),
    ('law = "neo-hookean"', 'law = "saint-venant-kirchhoff"'),
)


@pytest.mark.parametrize("changes", [(), (YEOH,), STIFF_ONLY, FIELD])
def test_the_written_robot_is_the_fitted_one(
    write: Write, tmp_path: Path, changes: tuple[tuple[str, str], ...]
) -> None:
    source, target = write(*changes), tmp_path / "fitted.toml"
    known = Fitted.of(build_robot(load(source)))
    adjustments = build_adjustments(known)
    value = np.asarray(adjustments.sigma) * np.random.default_rng(4).uniform(
        -0.7, 0.7, len(adjustments.names)
    )
    fitted = adjustments.adjusted(known.model, value)
    after = save_edited(source, target, calibrated_edits(known, adjustments, value))
    again = build_robot(after).model
    np.testing.assert_allclose(again.body.rest, fitted.body.rest, atol=1e-9)
    (law,), (expected,) = again.body.materials, fitted.body.materials
    assert type(law) is type(expected)
    for name in vars(expected):
        np.testing.assert_allclose(getattr(law, name), getattr(expected, name), rtol=1e-5)
    if fitted.body.factors is None:
        assert again.body.factors is None
    else:
        assert np.ptp(fitted.body.factors) > 0.05
        np.testing.assert_allclose(again.body.factors, fitted.body.factors, atol=1e-5)
    (pressed,), (contact,) = again.contacts, fitted.contacts
    np.testing.assert_allclose(pressed.compliance, contact.compliance, rtol=1e-5)
    gains = [v for name, v in zip(adjustments.names, value, strict=True) if name.endswith("gain")]
    np.testing.assert_allclose(after.sensors[0].gain, np.exp(gains), rtol=1e-5)


def test_what_may_not_differ_is_left(write: Write) -> None:
    told = '[calibration]\ncontact_layer = 0\ncavity_growth = "0 mm"\ngain = 0\n[estimator]'
    known = Fitted.of(build_robot(load(write(("[estimator]", told)))))
    adjustments = build_adjustments(known)
    assert len(adjustments.names) == 2 + 12
    edits = calibrated_edits(known, adjustments, np.zeros(14))
    assert {key[-1] for key in edits} == {"law", "young", "c1", "c2", "c3", "shift"}


def test_cables_are_shortened_as_far_as_that_is_known(linear_finger: Write) -> None:
    robot = build_robot(load(linear_finger()))
    known = Fitted.of(robot)
    assert known.shortened.all() and isinstance(known.model.actuators[0], ShortenedCable)
    # The gas is read, and the length is not fitted to but prescribed.
    np.testing.assert_array_equal(known.readings, range(6))
    assert known.names == robot.suite.readings[:6]
    sensors = robot.settings.sensors[:2]
    assert [sensor.name for sensor in sensors] == ["pressure", "electrodes"]
    blind = build_robot(robot.settings.model_copy(update={"sensors": sensors}), robot.mesh)
    told = Fitted.of(blind)
    assert not told.shortened.any() and told.model.actuators[0] is blind.model.actuators[0]
    with pytest.raises(ConfigError, match="sensor: missing, a calibration fits what they read"):
        Fitted.of(build_robot(robot.settings.model_copy(update={"sensors": ()}), robot.mesh))


ENCODER = """[[sensor]]
name = "encoder"
type = "cable-length"
cables = ["palm"]
channels = ["encoder_mm"]
"""
WINCH = 'command = { channel = "winch_mm", unit = "mm" }'


def test_what_is_read_of_an_actuator_is_what_drives_it() -> None:
    """Readings are the encoder's, the load cell's and three of a marker; the cable is the first drive."""
    both = Fitted.of(build_robot(settings_of(BEAM)))
    assert both.shortened.all() and both.told.tolist() == [0, -1, -1, -1, -1]
    load_cell = Fitted.of(build_robot(settings_of(BEAM, (ENCODER, ""), (WINCH, "")), both.robot.mesh))
    assert not load_cell.shortened.any() and load_cell.told.tolist() == [0, -1, -1, -1]
    for known in (both, load_cell):
        np.testing.assert_array_equal(known.readings, np.arange(len(known.told))[-3:])


def test_the_gain_of_a_single_reading_stays_a_number(tmp_path: Path) -> None:
    """A list for a barometer's gain was refused after the whole fit."""
    source, target = tmp_path / "robot.toml", tmp_path / "fitted.toml"
    sensors = BEAM.index("[[sensor]]")
    source.write_text(f"{BEAM[:sensors]}{BAROMETER}", encoding="utf-8")
    known = Fitted.of(build_robot(load(source)))
    adjustments = build_adjustments(known)
    value = np.where([name.endswith("gain") for name in adjustments.names], np.log(1.1), 0.0)
    after = save_edited(source, target, calibrated_edits(known, adjustments, value))
    assert after.sensors_of(PointPressureSettings)[0].gain == pytest.approx(1.1)
