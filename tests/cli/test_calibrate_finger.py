"""softfuse calibrate on one push of the finger, with a coarse body."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.robot.file import load
from softfuse.sensors.pressure.settings import PressureSettings

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "tests" / "data" / "finger_one_push.csv.gz"


@pytest.fixture(scope="module")
def coarse(linear_finger: Callable[..., Path]) -> Path:
    """The finger, coarse, with few parameters."""
    few = '[calibration]\ncavity_shift = "0 mm"\ncavity_growth = "0 mm"\n\n[estimator]'
    return linear_finger(("[estimator]", few))


@pytest.mark.slow
def test_what_was_fitted_is_in_the_config_and_the_report(
    code_of: Callable[..., int], tmp_path: Path, coarse: Path
) -> None:
    out = tmp_path / "fitted.toml"
    assert code_of("calibrate", coarse, RECORDING, "--out", out, "--quiet") == 0
    fitted = load(out)
    assert fitted.body.materials[0].law == "yeoh"
    (pressure,) = fitted.sensors_of(PressureSettings)
    assert len(pressure.gain) == 6 and np.ptp(pressure.gain) > 0
    assert np.ptp([chamber.dead_volume for chamber in fitted.chambers]) > 0
    assert fitted.cables[0].compliance > 0
    assert 0 < pressure.model_error < 0.5
    # Only a robot with a map of readings has such a file.
    assert not out.with_suffix(".npz").exists()
    text = out.with_suffix(".html").read_text()
    for said in (
        "palm zero",
        "tip left dead volume",
        "place on tip left in press",
        " Pa before",
        "tells [nat]",
    ):
        assert said in text


def test_a_recording_that_does_not_know_its_forces_is_told(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str], coarse: Path
) -> None:
    with gzip.open(RECORDING, "rt") as stream:
        text = stream.read().replace("true_force", "force")
    path = tmp_path / "blind.csv"
    path.write_text(text)
    assert code_of("calibrate", coarse, path, "--out", tmp_path / "a.toml", "--quiet") == 2
    told = capsys.readouterr().err
    assert "has no samples with known force" in told and "true_contact0_electrode" in told
