"""softfuse evaluate: what it writes, goes on from, and refuses."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.hardware.recording import read_recording

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def pad(code_of: Callable[..., int], coarse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a pad that was pressed at four places, with a coarse estimator."""
    out = tmp_path_factory.mktemp("evaluation") / "pad"
    assert code_of("evaluate", coarse, "--out", out, "--grid", "2", "--quiet") == 0
    return out


@pytest.mark.slow
def test_tables_hold_the_errors_of_the_samples(pad: Path) -> None:
    head, *rows = csv.reader((pad / "tables" / "table_2.csv").read_text().splitlines())
    # No corner of the workspace is within the circle.
    assert head[1] == "paper [%]" and [row[0] for row in rows] == ["all", "5 N", "10 N", "15 N"]
    for k, way in enumerate(("as_drawn", "calibrated")):
        said = np.genfromtxt(pad / "tables" / f"samples_{way}.csv", delimiter=",", names=True)
        assert len(said) == 12 and np.isfinite(said["force_N"]).all()
        error = 100 * np.abs(said["force_N"] / said["true_force_N"] - 1)
        assert float(rows[0][2 + 2 * k]) == pytest.approx(error.mean(), abs=0.006)
        assert float(rows[1][2 + 2 * k]) == pytest.approx(error[said["level"] == 1].mean(), abs=0.006)
        place = np.hypot(said["x_mm"] - said["true_x_mm"], said["y_mm"] - said["true_y_mm"])
        assert place.max() < 1.0
        # As drawn it is as sure as its sensors are; once calibrated it knows that a coarse body is wrong.
        sure = np.median(said["force_sigma_N"] / said["true_force_N"])
        assert sure > 0.05 if way == "calibrated" else sure < 0.01


@pytest.mark.slow
def test_everything_is_there_in_its_forms(pad: Path) -> None:
    text = (pad / "report.html").read_text()
    assert text.rstrip().endswith("</html>") and text.count("data:image/png;base64,") == 5
    for said in ("Table I", "Table II", "1.08", "10.9", "Figure 9", "Figure 11", "90 % intervals"):
        assert said in text
    assert (pad / "fitted.html").exists() and (pad / "tables" / "table_1.tex").read_text().startswith(
        "\\begin"
    )
    assert (pad / "figures" / "figure_10_calibrated.pdf").read_bytes().startswith(b"%PDF")
    assert len(list((pad / "recordings").glob("*.csv.gz"))) == 9
    recording = read_recording(
        pad / "recordings" / "press_003.csv.gz", ["flow0_V", "row0", "col7", "true_force_N"]
    )
    assert recording.complete and not recording.malformed.any()
    assert np.unique(recording.columns["sample"]).tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_it_goes_on_where_it_stopped(
    pad: Path, code_of: Callable[..., int], coarse: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = {path: path.stat().st_mtime_ns for path in pad.rglob("*.npz")}
    gone = pad / "estimates" / "calibrated" / "press_001.npz"
    gone.unlink()
    before = (pad / "tables" / "table_2.csv").read_text()
    assert code_of("evaluate", coarse, "--out", pad, "--grid", "2") == 0
    assert "Table II: force error" in capsys.readouterr().out
    after = {path: path.stat().st_mtime_ns for path in pad.rglob("*.npz")}
    assert {path for path in kept if after[path] != kept[path]} == {gone}
    assert (pad / "tables" / "table_2.csv").read_text() == before


def test_a_folder_of_another_evaluation_is_refused(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mark = tmp_path / "evaluation.json"
    config = CONFIGS / "pad.toml"
    mark.write_text(json.dumps({"softfuse": "0", "config": "x", "grid": "10", "seed": "1"}))
    assert code_of("evaluate", config, "--out", tmp_path) == 2
    assert "holds an evaluation by another config: give another folder" in capsys.readouterr().err
    mark.write_text("nothing")
    assert code_of("evaluate", config, "--out", tmp_path) == 2
    assert "evaluation.json does not tell of an evaluation" in capsys.readouterr().err
    mark.unlink()
    (tmp_path / "estimates" / "as_drawn").mkdir(parents=True)
    (tmp_path / "estimates" / "as_drawn" / "press_000.npz").touch()
    assert code_of("evaluate", config, "--out", tmp_path) == 2
    assert "holds parts of an evaluation without evaluation.json" in capsys.readouterr().err


def test_a_grid_of_one_place_is_refused(code_of: Callable[..., int], tmp_path: Path) -> None:
    assert code_of("evaluate", CONFIGS / "pad.toml", "--out", tmp_path, "--grid", "1") == 2
