"""softfuse reduce on a coarse pad: charts that are made once, and estimates with them."""

import csv
import gzip
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.errors import ConfigError
from softfuse.robot.file import load
from softfuse.robot.reduced import build_regions

RECORDING = Path(__file__).parents[1] / "data" / "pad_nominal_two_presses.csv.gz"
FRAMES = 330


def pressed_at() -> tuple[float, float]:
    """Where the first press of the recording is, in mm."""
    with gzip.open(RECORDING, "rt", newline="") as stream:
        row = next(row for row in csv.DictReader(stream) if row["sample"] == "1")
    return float(row["true_x_mm"]), float(row["true_y_mm"])


@pytest.fixture(scope="module")
def config(coarse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The coarse pad with a workspace of one small cell around the recording's first press."""
    text = coarse.read_text()
    for axis, middle in zip("xy", pressed_at(), strict=True):
        old = f'{axis} = ["-30 mm", "30 mm"]'
        assert text.count(old) == 1
        text = text.replace(old, f'{axis} = ["{middle - 2} mm", "{middle + 2} mm"]')
    text += "\n[reduction]\ndisplacements = 40\npressures = 12\nside = 1\nnear = 16\n"
    path = tmp_path_factory.mktemp("reduced") / "one_cell.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def charts(config: Path, code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("charts") / "new"
    assert code_of("reduce", config, "--out", folder, "--quiet") == 0
    return folder


def test_charts_are_made_once(config, charts, code_of, capsys) -> None:
    before = {path: path.stat().st_mtime_ns for path in charts.iterdir()}
    assert [path.name for path in before] == ["chart-0000.npz"]
    assert code_of("reduce", config, "--out", charts) == 0
    assert "1 charts in" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in charts.iterdir()} == before


@pytest.mark.slow
def test_estimates_with_charts_are_those_of_the_full_body(config, charts, code_of, tmp_path: Path) -> None:
    with gzip.open(RECORDING, "rt") as stream:
        lines = stream.read().splitlines()[: FRAMES + 1]
    recording = tmp_path / "press.csv"
    recording.write_text("\n".join(lines) + "\n")
    found = {}
    for name, more in (("full", ()), ("charts", ("--charts", charts))):
        out = tmp_path / name
        assert code_of("estimate", config, recording, "--out", out, "--quiet", *more) == 0
        with (out / "estimates.csv").open(newline="") as stream:
            found[name] = list(csv.DictReader(stream))
        assert json.loads((out / "summary.json").read_text())["frames"] == FRAMES
    pairs = list(zip(found["full"], found["charts"], strict=True))
    both = [
        (float(a["force_N"]), float(b["force_N"])) for a, b in pairs if a["status"] == b["status"] == "ok"
    ]
    assert len(both) > 30
    assert max(abs(a - b) for a, b in both) < 0.03 * max(a for a, _ in both)


def test_charts_of_another_pad_are_refused(coarse, charts, code_of, tmp_path, capsys) -> None:
    arguments = ("--out", tmp_path / "out", "--charts", charts, "--quiet")
    assert code_of("estimate", coarse, RECORDING, *arguments) == 2
    assert "charts are missing" in " ".join(capsys.readouterr().err.split())
    changed = tmp_path / "changed.toml"
    changed.write_text(coarse.read_text().replace("0.6 MPa", "0.7 MPa"))
    assert code_of("reduce", changed, "--out", charts, "--quiet") == 2
    assert "another robot" in " ".join(capsys.readouterr().err.split())


def test_a_device_that_nothing_presses_is_not_reduced(coarse) -> None:
    with pytest.raises(ConfigError, match="contact: missing, this needs something that may press"):
        build_regions(load(coarse).model_copy(update={"contacts": ()}))


def test_what_presses_anywhere_on_a_surface_is_told_what_to_give() -> None:
    with pytest.raises(ConfigError, match="give it a direction and a workspace"):
        build_regions(load(Path(__file__).parents[2] / "configs" / "dome.toml"))
