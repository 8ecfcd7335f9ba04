"""softfuse calibrate on two presses of the reference pad, with a coarse body."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.flow import FlowSettings

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz"


@pytest.fixture(scope="module")
def fitted(code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory, coarse: Path) -> Path:
    """The config that it writes."""
    out = tmp_path_factory.mktemp("fit") / "fitted.toml"
    assert code_of("calibrate", coarse, RECORDING, "--out", out, "--quiet") == 0
    return out


@pytest.fixture(scope="module")
def config(fitted: Path) -> RobotSettings:
    return load(fitted)


def test_what_was_fitted_is_in_the_config(config: RobotSettings) -> None:
    assert config.body.materials[0].law == "yeoh"
    # A coarse body is too stiff by itself.
    assert 0.6e6 / 6 * 0.6 < config.body.materials[0].c1 < 0.6e6 / 6 * 1.3
    assert 1e-11 < config.contact().compliance < 1e-8
    assert 0 < config.estimator.model_error < 0.2
    (flow,) = config.sensors_of(FlowSettings)
    assert len(flow.gain) == 4 and np.ptp(flow.gain) > 0
    for chamber in config.chambers:
        assert 0 < np.abs([*chamber.shift, *chamber.growth]).max() < 1e-3


def test_its_comments_are_those_of_the_source(fitted: Path, coarse: Path) -> None:
    comments = [line for line in coarse.read_text().split("\n") if line.startswith("#")]
    assert [line for line in fitted.read_text().split("\n") if line.startswith("#")] == comments


def test_the_report_is_whole(fitted: Path) -> None:
    text = fitted.with_suffix(".html").read_text()
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    for said in (
        "stiffness",
        "(+,+) shift z",
        "(-,-) gain",
        "What cannot be told apart",
        "The next press",
        "nat",
    ):
        assert said in text
    assert text.count("data:image/png;base64,") == 2


@pytest.mark.parametrize(
    ("out", "told"), [("a.npz", "give a file that ends with .toml"), ("no/a.toml", "there is no folder")]
)
def test_a_place_that_cannot_be_written_is_told_at_once(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    coarse: Path,
    out: str,
    told: str,
) -> None:
    assert code_of("calibrate", coarse, RECORDING, "--out", tmp_path / out) == 2
    assert told in capsys.readouterr().err


@pytest.mark.slow
def test_presses_of_several_recordings_are_different_ones(
    code_of: Callable[..., int], tmp_path: Path, coarse: Path
) -> None:
    again = tmp_path / "again.csv.gz"
    again.write_bytes(RECORDING.read_bytes())
    out = tmp_path / "fitted.toml"
    assert code_of("calibrate", coarse, RECORDING, again, "--presses", "0", "--out", out, "--quiet") == 0
    text = out.with_suffix(".html").read_text()
    assert "0 of pad_nominal_two_presses.csv.gz" in text and "0 of again.csv.gz" in text


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "[estimator]",
            "[calibration]\nstiffness = -1.0\n[estimator]",
            "calibration.stiffness: -1.0 must be",
        ),
        (
            "[estimator]",
            "[calibration]\nstiffness = 0\nstiffening = 0\ncontact_layer = 0\ngain = 0\n"
            'cavity_shift = "0 mm"\ncavity_growth = "0 mm"\n[estimator]',
            "calibration: all is 0, so that there is nothing to fit",
        ),
    ],
)
def test_a_mistake_in_the_config_is_told(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    coarse: Path,
    old: str,
    new: str,
    told: str,
) -> None:
    path = tmp_path / "pad.toml"
    path.write_text(coarse.read_text().replace(old, new))
    assert code_of("calibrate", path, RECORDING, "--out", tmp_path / "a.toml", "--quiet") == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "a.toml").exists()
