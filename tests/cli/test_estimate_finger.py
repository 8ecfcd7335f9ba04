"""softfuse estimate on one push of the finger, with faults put into the recording, on a coarse finger."""

import csv
import gzip
import json
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Tracked
from softfuse.hardware.recording import read_recording
from softfuse.report.recording_report import EstimateRows, summary, write_report
from softfuse.report.study import Study
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.sensors.status import Status

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "tests" / "data" / "finger_one_push.csv.gz"
POINTS = ("p0", "p1", "p2", "p3")
CHAMBERS = [f"{part}_{side}" for part in ("base", "middle", "tip") for side in ("left", "right")]
MISSING, LOST = 34, 26
"""Frames whose pressure is missing, whose cable length is absent."""


def recorded() -> list[list[str]]:
    """The head and the rows of the recording."""
    with gzip.open(RECORDING, "rt") as stream:
        return [line.split(",") for line in stream.read().splitlines()]


def written(path: Path, rows: list[list[str]]) -> Path:
    """A recording of a head and rows."""
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


def without(rows: list[list[str]], *names: str) -> list[list[str]]:
    """The rows without some columns."""
    keep = [k for k, name in enumerate(rows[0]) if name not in names]
    return [[row[k] for k in keep] for row in rows]


@pytest.fixture(scope="module")
def coarse(linear_finger: Callable[..., Path]) -> Path:
    """The finger, coarse. How good estimates are is not asked here; a softer material helps a bit."""
    return linear_finger(('young = "0.6 MPa"', 'young = "0.3 MPa"'))


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rows = recorded()
    at = {name: k for k, name in enumerate(rows[0])}
    rows[1 + MISSING][at["pressure1_V"]] = ""
    rows[1 + LOST][at["cable0_mm"]] = ""
    return written(tmp_path_factory.mktemp("recording") / "push.csv", rows)


@pytest.fixture(scope="module")
def results(
    code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory, coarse: Path, faulty: Path
) -> Path:
    """The folder that `softfuse estimate` makes of them."""
    out = tmp_path_factory.mktemp("out") / "finger"
    assert code_of("estimate", coarse, faulty, "--out", out, "--quiet") == 0
    return out


@pytest.fixture(scope="module")
def rows(results: Path) -> list[dict[str, str]]:
    with (results / "estimates.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def truth(faulty: Path) -> list[dict[str, str]]:
    with faulty.open(newline="") as stream:
        return list(csv.DictReader(stream))


def values(rows: list[dict[str, str]], *names: str) -> np.ndarray:
    """Some columns of all rows (n, names); what is empty is NaN."""
    return np.array([[float(row[name] or "nan") for name in names] for row in rows])


def test_every_frame_has_a_row_with_the_agreed_columns(
    rows: list[dict[str, str]], truth: list[dict[str, str]]
) -> None:
    total = ("x_mm", "y_mm", "z_mm", "force_N", "x_sigma_mm", "y_sigma_mm", "z_sigma_mm", "force_sigma_N")
    each = ("place", "x_mm", "y_mm", "z_mm", "force_N", "force_sigma_N")
    measured = [f"pressure_{name}{of}_Pa" for name in CHAMBERS for of in ("", "_misfit")]
    points = [f"{name}_{axis}_mm" for name in POINTS for axis in "xyz"]
    bending = [what for j in range(4) for what in (f"bend{j}_deg", f"curvature{j}_1_m")]
    assert list(rows[0]) == [
        *("time_s", "contacts", *total),
        *(f"hand{c}_{what}" for c in range(2) for what in each),
        *("palm_mm", "palm_N", *(f"{name}_Pa" for name in CHAMBERS), *measured),
        *("cable_palm_mm", "cable_palm_misfit_mm", *points, *bending),
        *("tip_bend_deg", "residual", "latency_ms", "status"),
    ]
    assert len(rows) == len(truth) and all(row["status"] for row in rows)
    always = ["force_N", "palm_mm", "palm_N", *points, *bending, "tip_bend_deg", "latency_ms"]
    assert np.isfinite(values(rows, *always)).all()


def test_the_push_is_found_on_its_electrode(rows: list[dict[str, str]], truth: list[dict[str, str]]) -> None:
    at = [k for k, row in enumerate(truth) if row["sample"] not in ("", "0")]
    held = [rows[k] for k in at]
    assert [row["contacts"] for row in held] == ["1"] * 4
    assert {row["hand0_place"] for row in held} == {"tip left"}
    assert {row["hand1_place"] + row["hand1_x_mm"] for row in held} == {""}
    force = values(held, "hand0_force_N")
    assert (np.diff(force, axis=0) > 0).all() and force[0] > 0 and force[-1] < 1.0
    np.testing.assert_array_equal(values(held, "force_N"), force)
    assert rows[0]["contacts"] == "0" and rows[0]["hand0_place"] == ""
    # Where it touches is said on the body at rest.
    np.testing.assert_allclose(
        values(held, *(f"hand0_{axis}_mm" for axis in "xyz")), [[108.0, 10.0, 10.0]] * 4
    )


def test_the_shape_follows_cable_and_push(rows: list[dict[str, str]], truth: list[dict[str, str]]) -> None:
    names = [f"{name}_{axis}_mm" for name in POINTS for axis in "xyz"]
    found, true = values(rows, *names), values(truth, *(f"true_{name}" for name in names))
    np.testing.assert_allclose(found[0], true[0], atol=0.5)
    last = max(k for k, row in enumerate(truth) if row["sample"] not in ("", "0"))
    moved, truly = (found - found[0])[last], (true - true[0])[last]
    # All points go where they truly go, some less far.
    assert moved @ truly > 0.9 * np.linalg.norm(moved) * np.linalg.norm(truly)
    assert 0.3 < np.linalg.norm(moved) / np.linalg.norm(truly) < 1.2
    assert 6.0 < values(rows, "palm_mm").max() < 10.5 and values(rows, "palm_N").max() > 1.0
    turned = values(rows, "tip_bend_deg")[:, 0]
    assert turned.max() > 20.0 and abs(turned[0]) < 1.0
    bend, curvature = values(rows, "bend1_deg"), values(rows, "curvature1_1_m")
    np.testing.assert_allclose(np.deg2rad(bend) / 0.03, curvature, atol=2e-3)


def test_faults_are_flagged_and_the_rest_is_estimated(rows: list[dict[str, str]]) -> None:
    assert "pressure missing" in rows[MISSING]["status"] and "malformed row" in rows[MISSING]["status"]
    missing, there = (f"pressure_{CHAMBERS[k]}_misfit_Pa" for k in (1, 0))
    assert rows[MISSING][missing] == "" and rows[MISSING][there] != ""
    assert "cable missing" in rows[LOST]["status"] and rows[LOST]["palm_mm"] != ""


def test_the_summary_tells_errors_and_counts(results: Path, truth: list[dict[str, str]]) -> None:
    numbers = json.loads((results / "summary.json").read_text())
    assert numbers["robot"] == "Soft Finger" and numbers["frames"] == len(truth)
    table = numbers["position_error_mm"]
    levels = [f"level_{k}" for k in (1, 2, 3, 4)]
    assert list(table) == ["all", "with_cable", "without_cable", *levels, *POINTS]
    assert table["all"]["n"] == 4 * 4 and table["without_cable"] == {"mean": None, "std": None, "n": 0}
    assert numbers["samples"] == 4 and numbers["samples_without_estimate"] == 0
    assert set(numbers["force_error_percent"]) == {"all", "contact0", "contact1", *levels}
    assert numbers["contacts_true"] == 4 and numbers["contacts_missed"] == 0
    # A tip is there all the time; before it presses, the electrode may feel it.
    assert numbers["phantom_force_N"]["without_contact"] is None
    assert numbers["phantom_force_N"]["without_force"] >= 0.0
    assert numbers["latency_ms"]["p50"] > 0


def test_the_report_is_whole(results: Path) -> None:
    text = (results / "report.html").read_text(encoding="utf-8")
    assert text.startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    headings = ["Recording", "Table III: position error", "Force error", "Contacts", "Forces", "Readings"]
    headings += ["Cables", "Chambers", "Points", "Bending", "Shape", "Latency"]
    places = [text.index(f"<h2>{heading}</h2>") for heading in headings]
    assert places == sorted(places)
    assert text.count("data:image/png;base64,") == 10
    assert "http" not in text


def test_shapes_of_the_pull_and_of_the_touch_are_kept(results: Path) -> None:
    import meshio

    shapes = [meshio.read(path) for path in sorted(results.glob("shape_*.vtu"))]
    assert len(shapes) == 2
    sure = [shape.point_data["displacement_sigma"].max() for shape in shapes]
    assert all(0 < each < 5e-3 for each in sure)
    largest = [np.linalg.norm(shape.point_data["displacement"], axis=1).max() for shape in shapes]
    assert min(largest) > 5e-3


@pytest.mark.parametrize(
    ("dropped", "told"),
    [
        (["pressure0_V", "pressure4_V"], "lacks the columns 'pressure0_V', 'pressure4_V'"),
        (["cable0_mm"], "lacks the column 'cable0_mm'"),
        (["true_p2_x_mm"], "lacks the column 'true_p2_x_mm'"),
        (["true_contact1_electrode"], "lacks the column 'true_hand1_place'"),
    ],
)
def test_what_a_recording_lacks_is_told_in_a_line(
    code_of: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    coarse: Path,
    dropped: list[str],
    told: str,
) -> None:
    recording = written(tmp_path / "lacking.csv", without(recorded(), *dropped))
    assert code_of("estimate", coarse, recording, "--out", tmp_path / "out", "--quiet") == 2
    err = capsys.readouterr().err
    assert told in err and "Traceback" not in err and err.count("\n") == 1


def test_without_truth_there_is_no_evaluation(tmp_path: Path, coarse: Path) -> None:
    names = [name for name in recorded()[0] if name.startswith("true_")]
    path = written(tmp_path / "plain.csv", without(recorded()[:3], "press", "sample", *names))
    robot = build_robot(load(coarse))
    study = Study(robot, read_recording(path, []))
    nothing, readings = np.zeros(2), robot.model.n_readings
    rows = (tmp_path / "estimates.csv").open("w+", newline="")
    writer = EstimateRows(rows, study)
    at = np.broadcast_to(np.eye(3), (2, 3, 3))
    for k in range(2):
        tracked = Tracked(
            time_s=0.1 * k,
            touching=nothing > 0,
            location_m=np.full((2, 3), np.nan),
            location_sigma_m=np.full((2, 2), np.nan),
            contact_force_N=nothing,
            force_covariance_N2=np.diag(nothing),
            places=at,
            covariance=np.zeros((11, 11)),
            attached=np.zeros(7),
            reading=np.zeros(readings),
            sigma=np.ones(readings),
            valid=np.zeros(readings, bool),
            misfit=np.full(readings, np.nan),
            evidence=None,
            details={"electrodes": None},
            statuses=(Status.no_contact,),
            latency_s=0.01,
        )
        study.see(Estimate(tracked, None, robot.model.rest_state(jnp.asarray(at))))
        writer.write()
    numbers = summary(study, None)
    assert not {"position_error_mm", "force_error_percent", "phantom_force_N", "samples"} & set(numbers)
    write_report(tmp_path / "report.html", study, None, numbers)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Table III" not in text and "<h2>Points</h2>" in text
    # Nothing has touched and nothing was pulled: there is no shape to keep, and no number to be guessed.
    assert "<h2>Shape</h2>" not in text and not study.peaks
    with rows:
        rows.seek(0)
        told = list(csv.DictReader(rows))
    assert [row["p0_x_mm"] for row in told] == ["117.000"] * 2 and told[0]["pressure_base_left_Pa"] == ""
    assert told[0]["residual"] == "" and told[0]["hand0_place"] == "" and told[0]["base_left_Pa"] == "0.00"
