"""What recordings say of the truth, by names and by numbers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks import stand_in

from softfuse.errors import RecordingError
from softfuse.experiment.accuracy import NOWHERE
from softfuse.hardware.recording import Recording, read_recording
from softfuse.report.columns import Column
from softfuse.report.truth import Truth

PLACES = {"tip left": np.eye(3), "tip right": np.eye(3), "base": np.eye(3)}


def columns(**changed: Any) -> Any:
    """Those of a robot with two contacts at electrodes, a cable, a chamber, a point."""
    names = ["force_N", "x_mm", "y_mm", "palm_mm", "palm_N", "gut_Pa", "tip_x_mm", "tip_y_mm", "tip_z_mm"]
    given = {
        "columns": [Column(name, 3) for name in names],
        "slots": ("push0", "push1"),
        "named": (PLACES, PLACES),
        "places": tuple(PLACES),
        "cables": {"palm": "palm"},
        "chambers": {"gut": "gut"},
        "points": {"tip": "tip"},
    }
    return stand_in(**(given | changed))


def recording(tmp_path: Path, head: str, *rows: str) -> Recording:
    path = tmp_path / "truth.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return read_recording(path, [])


NUMBERED = (
    "time_s,sample,press,true_tip_x_mm,true_tip_y_mm,true_tip_z_mm,true_force0_N,true_contact0_electrode,"
    "true_cable_mm,true_cable_N,true_pressure0_Pa"
)
NAMED = NUMBERED.replace("true_force0_N", "true_push0_force_N").replace("true_cable_", "true_palm_")
ROWS = (
    "0,0,0,1,2,3,0,-1,0,0,0",
    "1,0,0,1,2,3,0,2,0,0,10",
    "2,1,0,4,5,6,2,2,5,1.5,20",
    "3,2,0,,5,6,2,2,5,1.5,30",
)


@pytest.mark.parametrize(
    "head",
    [
        NUMBERED,
        NAMED.replace("true_contact0_electrode", "true_push0_place").replace("true_pressure0", "true_gut"),
    ],
)
def test_names_and_numbers_say_the_same(tmp_path: Path, head: str) -> None:
    """A frame without anything near, one before the contact, a sample, and one whose point is not known."""
    truth = Truth.of(recording(tmp_path, head, *ROWS), columns())
    points = ["tip_x_mm", "tip_y_mm", "tip_z_mm"]
    assert truth.samples(points).tolist() == [2]
    known = truth.matrix(points)
    assert known is not None
    np.testing.assert_allclose(known[2], [4, 5, 6])
    np.testing.assert_allclose(truth.get("palm_mm"), [0, 0, 5, 5])
    np.testing.assert_allclose(truth.get("palm_N"), [0, 0, 1.5, 1.5])
    np.testing.assert_allclose(truth.get("gut_Pa"), [0, 10, 20, 30])
    assert truth.contact_N[:, 0].tolist() == [0, 0, 2, 2]
    assert truth.place[:, 0].tolist() == [NOWHERE, 2, 2, 2]
    assert truth.without_force.tolist() == [True, True, False, False]
    assert truth.without_contact.tolist() == [True, False, False, False]
    assert truth.depth_mm is None and np.isnan(truth.get("force_N")).all()


def test_without_truth_nothing_is_known(tmp_path: Path) -> None:
    truth = Truth.of(recording(tmp_path, "time_s,a", "0,1"), columns())
    assert truth.contact_N.shape == truth.place.shape == (1, 0) and truth.columns == {}
    assert truth.matrix(["force_N"]) is None and not truth.samples(["force_N"]).size
    assert not truth.without_force.any() and not truth.without_contact.any()


def test_truth_of_some_points_only_is_a_mistake(tmp_path: Path) -> None:
    several = columns(
        points={"tip": "tip", "end": "end"},
        columns=[*columns().columns, *(Column(f"end_{axis}_mm", 3) for axis in "xyz")],
    )
    with pytest.raises(RecordingError, match="lacks the columns 'true_end_x_mm', 'true_end_y_mm'"):
        Truth.of(recording(tmp_path, NUMBERED, ROWS[0]), several)


def test_a_force_without_its_place_is_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="lacks the column 'true_push0_place'"):
        Truth.of(recording(tmp_path, "time_s,sample,true_force0_N", "0,1,2"), columns())
    free = Truth.of(recording(tmp_path, "time_s,sample,true_force0_N", "0,1,2"), columns(named=({}, {})))
    assert free.contact_N.tolist() == [[2.0]] and free.place.shape == (1, 0)
