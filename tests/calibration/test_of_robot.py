"""Fitted parameters become settings whose device is the fitted one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from softfuse.config.build_device import build_device

from softfuse.calibration.of_robot import build_adjustments, calibrated_edits
from softfuse.errors import ConfigError
from softfuse.robot.file import load, save_edited
from softfuse.robot.mesh import build_mesh

Write = Callable[..., Path]

COARSE = (
    ('surface_size = "12 mm"', 'surface_size = "30 mm"'),
    ('base_size = "12 mm"', 'base_size = "28 mm"'),
    ('fine_depth = "3 mm"', 'fine_depth = "0 mm"'),
)
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
def test_the_written_device_is_the_fitted_one(
    write: Write, tmp_path: Path, changes: tuple[tuple[str, str], ...]
) -> None:
    source, target = write(*COARSE, *changes), tmp_path / "fitted.toml"
    config = load(source)
    mesh = build_mesh(config)
    device = build_device(config, mesh)
    adjustments = build_adjustments(config, device, mesh)
    value = np.asarray(adjustments.sigma) * np.random.default_rng(4).uniform(
        -0.7, 0.7, len(adjustments.names)
    )
    fitted = adjustments.adjusted(device, value)
    after = save_edited(source, target, calibrated_edits(config, device, adjustments, value))
    again = build_device(after)
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
    np.testing.assert_allclose(again.contact.disc.compliance, fitted.contact.disc.compliance, rtol=1e-5)
    gains = [v for name, v in zip(adjustments.names, value, strict=True) if name.endswith("gain")]
    np.testing.assert_allclose(after.sensors.flow.gain, np.exp(gains), rtol=1e-5)


def test_what_may_not_differ_is_left(write: Write) -> None:
    told = '[calibration]\ncontact_layer = 0\ncavity_growth = "0 mm"\ngain = 0\n[estimator]'
    config = load(write(*COARSE, ("[estimator]", told)))
    mesh = build_mesh(config)
    device = build_device(config, mesh)
    adjustments = build_adjustments(config, device, mesh)
    assert len(adjustments.names) == 2 + 12
    edits = calibrated_edits(config, device, adjustments, np.zeros(14))
    assert {key[-1] for key in edits} == {"law", "young", "c1", "c2", "c3", "shift"}


def test_cables_of_unknown_length_are_told(write_finger: Write, finger_text: str) -> None:
    sensor = finger_text[finger_text.index("[sensors.cable]") : finger_text.index("[estimator]")]
    config = load(write_finger((sensor, "")))
    with pytest.raises(ConfigError, match="a calibration must know by how much cables are shortened"):
        build_adjustments(config, None, None)  # what is built does not matter
