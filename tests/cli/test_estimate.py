"""softfuse estimate and calibrate: one press of a recording, with faults put into it, on a coarse pad."""

import csv
import gzip
import json
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz"
FRAMES = 330
CHAMBERS = ("minus_minus", "minus_plus", "plus_minus", "plus_plus")
MISSING, CUT, LOST, SATURATED = 20, 60, 140, 300
"""Frames whose flow is missing, whose line is cut, whose electrode is dead, whose flow is clipped."""


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beginning of a recording, up to the first force level, with faults."""
    with gzip.open(RECORDING, "rt") as stream:
        lines = stream.read().splitlines()[: FRAMES + 1]
    rows = [line.split(",") for line in lines]
    at = {name: k for k, name in enumerate(rows[0])}
    rows[1 + MISSING][at["flow1_V"]] = ""
    rows[1 + CUT] = rows[1 + CUT][:7]
    for row in rows[1 + LOST :]:
        row[at["row0"]] = "nan"
    rows[1 + SATURATED][at["flow0_V"]] = "0.0000"
    path = tmp_path_factory.mktemp("recording") / "faulty.csv"
    path.write_text("\n".join(",".join(row) for row in rows)[:-9])  # the last line is cut as well
    return path


@pytest.fixture(scope="module")
def results(
    code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory, coarse: Path, faulty: Path
) -> Path:
    """The folder that `softfuse estimate` makes of them."""
    out = tmp_path_factory.mktemp("out") / "new" / "folder"
    assert code_of("estimate", coarse, faulty, "--out", out, "--quiet") == 0
    return out


@pytest.fixture(scope="module")
def rows(results: Path) -> list[dict[str, str]]:
    with (results / "estimates.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_frame_has_a_row_with_the_agreed_columns(rows: list[dict[str, str]]) -> None:
    assert len(rows) == FRAMES
    told = ("x_mm", "y_mm", "z_mm", "force_N", "x_sigma_mm", "y_sigma_mm", "z_sigma_mm", "force_sigma_N")
    measured = [f"flow_{name}{of}_mm3" for name in CHAMBERS for of in ("", "_misfit")]
    head = ["time_s", "contacts", *told, *(f"{name}_mm3" for name in CHAMBERS), *measured]
    assert list(rows[0]) == [*head, "residual", "latency_ms", "status"]
    assert all(row["status"] and float(row["latency_ms"]) > 0 for row in rows)


def test_frames_are_smoothed(results: Path, rows: list[dict[str, str]]) -> None:
    with (results / "smoothed.csv").open(newline="") as stream:
        smoothed = list(csv.DictReader(stream))
    assert [each["time_s"] for each in smoothed] == [row["time_s"] for row in rows]
    what = ("x_mm", "y_mm", "z_mm", "force_N", "x_sigma_mm", "y_sigma_mm", "z_sigma_mm", "force_sigma_N")
    drifts = [f"flow_{name}_{each}_mm3" for name in CHAMBERS for each in ("drift", "drift_sigma")]
    both = [f"{way}_{each}" for way in ("filtered", "smoothed") for each in what]
    assert list(smoothed[0]) == ["time_s", *both, *drifts, "outliers"]
    for row, each in zip(rows, smoothed, strict=True):
        if row["contacts"] == "0":
            assert float(each["filtered_force_N"]) == 0.0
        elif row["status"] == "electrodes lost":
            # Of a model of which nothing is known a press is off by some percent.
            assert float(each["filtered_force_N"]) == pytest.approx(float(row["force_N"]), rel=0.15, abs=0.1)
            assert float(each["filtered_x_mm"]) == pytest.approx(float(row["x_mm"]), abs=0.3)
    numbers = json.loads((results / "summary.json").read_text())
    off = numbers["smoothing"]["force_rms_N"]
    assert off["filtered"] < 1.2 * off["frame_by_frame"] and off["smoothed"] < 1.2 * off["frame_by_frame"]
    assert numbers["smoothing"]["place_outliers"] == 0


def test_a_press_is_found_where_and_when_it_is(rows: list[dict[str, str]], faulty: Path) -> None:
    with faulty.open(newline="") as stream:
        truth = list(csv.DictReader(stream))
    at = next(i for i, row in enumerate(truth) if row["sample"] == "1")
    found, true = rows[at], truth[at]
    for axis in "xy":
        assert abs(float(found[f"{axis}_mm"]) - float(true[f"true_{axis}_mm"])) < 0.5
    # A mesh this coarse cannot be right to some percent, only to some tenth.
    assert float(found["force_N"]) == pytest.approx(float(true["true_force_N"]), rel=0.3)
    assert rows[10]["contacts"] == "0" and rows[10]["status"] == "no contact"
    assert rows[10]["x_mm"] == "" and float(rows[10]["force_N"]) == 0.0


def test_faults_are_flagged_and_the_rest_is_estimated(rows: list[dict[str, str]]) -> None:
    assert rows[0]["status"] == "no contact"
    assert "flow missing" in rows[MISSING]["status"]
    assert "malformed row" in rows[CUT]["status"]
    assert "electrodes lost" in rows[LOST + 1]["status"]
    assert "flow saturated" in rows[SATURATED]["status"]
    assert "malformed row" in rows[-1]["status"]
    touching = [row for row in rows if row["contacts"] == "1"]
    assert len(touching) > 150
    known = [row for row in touching if row["force_N"]]
    assert len(known) > 0.95 * len(touching)
    assert all(np.isfinite(float(row["force_N"])) for row in known)


def test_the_summary_tells_counts_and_errors(results: Path) -> None:
    numbers = json.loads((results / "summary.json").read_text())
    assert numbers["frames"] == FRAMES and numbers["malformed_rows"] == FRAMES - LOST + 2
    for key in ("location_error_mm", "force_error_percent"):
        assert set(numbers[key]) == {"all", "circle", "level_1"}
        assert set(numbers[key]["all"]) == {"mean", "std", "n"}
        assert numbers[key]["all"]["n"] == 1


def test_the_report_is_whole(results: Path) -> None:
    text = (results / "report.html").read_text()
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    assert "Table I" in text and "Table II" in text
    assert text.count("data:image/png;base64,") == 9
    assert "<h2>Smoothed frames</h2>" in text
    assert "http" not in text
    shape = meshio.read(results / "shape_00.vtu").point_data
    moved, sure = (np.abs(shape[name]).max() for name in ("displacement", "displacement_sigma"))
    assert 0 < sure < moved


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["estimate", "{coarse}", "no.csv", "--out", "{tmp}"], "cannot open the recording no.csv"),
        (["estimate", "no.toml", "{faulty}", "--out", "{tmp}"], "no.toml: cannot be read"),
        (["estimate", "{coarse}", "{coarse}", "--out", "{tmp}"], "lacks the column 'time_s'"),
        (["estimate", "{coarse}", "{faulty}", "--out", "{coarse}"], "cannot be written: "),
        (
            ["calibrate", "{coarse}", "{faulty}", "--presses", "7", "--out", "{tmp}/a.toml"],
            "has no samples in the presses 7",
        ),
        (
            ["calibrate", "{coarse}", "{faulty}", "--presses", "0..4", "--out", "{tmp}/a.toml"],
            '--presses "0..4" is no list of numbers',
        ),
    ],
)
def test_a_mistake_is_told_without_a_traceback(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    coarse: Path,
    faulty: Path,
    arguments: list[str],
    told: str,
) -> None:
    named = [a.format(coarse=coarse, faulty=faulty, tmp=tmp_path) for a in arguments]
    assert code_of(*named) == 2
    err = capsys.readouterr().err
    assert told in err and "Traceback" not in err


def test_fewer_estimates_are_of_the_same_sensors(
    code_of: Callable[..., int], rows: list[dict[str, str]], coarse: Path, faulty: Path, tmp_path: Path
) -> None:
    assert code_of("estimate", coarse, faulty, "--out", tmp_path, "--every", "7", "--quiet") == 0
    with (tmp_path / "estimates.csv").open(newline="") as stream:
        fewer = {row["time_s"]: row for row in csv.DictReader(stream)}
    with faulty.open(newline="") as stream:
        samples = [k for k, row in enumerate(csv.DictReader(stream)) if row["sample"] == "1"]
    assert samples
    wanted = sorted({*range(0, FRAMES, 7), *samples})
    assert list(fewer) == [rows[k]["time_s"] for k in wanted]
    for k in wanted:
        one, other = rows[k], fewer[rows[k]["time_s"]]
        assert [one[f"flow_{c}_mm3"] for c in CHAMBERS] == [other[f"flow_{c}_mm3"] for c in CHAMBERS]
        assert (one["x_mm"], one["y_mm"]) == (other["x_mm"], other["y_mm"])
    at = rows[samples[0]]["time_s"]
    assert float(fewer[at]["force_N"]) == pytest.approx(float(rows[samples[0]]["force_N"]), rel=0.02)
