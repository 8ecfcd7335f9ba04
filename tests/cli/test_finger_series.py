"""A finger's frames and truth, made by hand."""

from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.cli.finger_series import FingerSeries, finger_frame
from softfuse.cli.finger_truth import FingerTruth, finger_truth
from softfuse.errors import RecordingError
from softfuse.estimation.tracked import Tracked
from softfuse.experiment.contact_accuracy import NOWHERE
from softfuse.experiment.posture import Posture
from softfuse.hardware.recording import Recording, read_recording
from softfuse.mechanics.solution import State
from softfuse.sensors.status import Status

PATCHES = np.arange(18.0).reshape(3, 2, 3)
"""Of three electrodes."""
INWARD = np.array([np.eye(3)[[k, k]] for k in range(3)])


def tracked(touching: list[bool], force: list[float], *statuses: Status) -> Tracked:
    """A frame of two slots, the first on electrode 2, the second on 0; a cable at 3 N, one pressure."""
    slots = SimpleNamespace(electrode=np.array([2, 0]))
    details = SimpleNamespace(
        electrodes=SimpleNamespace(slots=slots),
        pressure=SimpleNamespace(valid=np.array([Status.pressure_missing not in statuses])),
        cable_m=np.array([np.nan]),
    )
    return Tracked(
        0.5,
        np.array(touching),
        np.zeros((2, 3)),
        np.full((2, 2), np.nan),
        np.array(force),
        np.diag([0.04, 0.09]),
        np.zeros((2, 3, 3)),
        np.zeros((4, 4)),
        np.array([3.0, 1e5]),
        np.array([4e-3, 50.0]),
        np.ones(2),
        np.array([0.0, 2.0]),
        None,
        details,
        statuses or (Status.ok,),
        0.1,
    )


def posture(point: float = 0.0) -> Posture:
    """A cable that is 4 mm shorter; one point."""
    links, tip, answers = np.zeros(2), np.zeros(()), np.array([4e-3, 48.0])
    return Posture(np.full((1, 3), point), links, links, tip, PATCHES, INWARD, answers)


def state(*drive: float) -> State:
    return State(jnp.zeros(1), jnp.zeros(0), jnp.zeros(0), jnp.array([*drive, 3.0, 1e5]))


def test_a_contact_is_where_its_patches_bear() -> None:
    frame = finger_frame(tracked([True, False], [4.0, 0.0]), state(1.0, 3.0, 0.0, 0.0), posture())
    assert frame.electrode.tolist() == [2, NOWHERE]
    np.testing.assert_allclose(frame.place_m[0], 0.25 * PATCHES[2, 0] + 0.75 * PATCHES[2, 1])
    np.testing.assert_allclose(frame.force_N[0], [0, 0, 4.0])
    assert np.isnan(frame.place_m[1]).all() and np.isnan(frame.force_N[1]).all()


def test_a_touch_without_force_is_in_the_middle() -> None:
    frame = finger_frame(tracked([True, True], [0.0, 0.0]), state(0.0, 0.0, 0.0, 0.0), posture())
    assert frame.electrode.tolist() == [2, 0]
    np.testing.assert_allclose(frame.place_m, PATCHES[[2, 0]].mean(axis=1))


def test_a_shape_that_was_lost_is_not_told() -> None:
    now = tracked([True, False], [np.nan, 0.0], Status.inverted)
    frame = finger_frame(now, state(0.0, 0.0, 0.0, 0.0), posture())
    assert frame.electrode.tolist() == [2, NOWHERE]
    assert np.isnan(frame.posture.point_m).all() and np.isnan(frame.place_m).all()


def test_a_pressure_that_is_not_measured_is_not_told() -> None:
    for statuses, told in (((), 50.0), ((Status.pressure_missing,), np.nan)):
        now = tracked([False, False], [0.0, 0.0], *statuses)
        frame = finger_frame(now, state(0.0, 0.0, 0.0, 0.0), posture())
        np.testing.assert_array_equal(frame.pressure_Pa, [told])


def recording(tmp_path: Path, head: str, *rows: str) -> Recording:
    path = tmp_path / "truth.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return read_recording(path, [])


HEAD = (
    "time_s,sample,press,true_tip_x_mm,true_tip_y_mm,true_tip_z_mm,true_force0_N,true_contact0_electrode,"
    "true_cable_mm,true_cable_N"
)


@pytest.fixture
def truth(tmp_path: Path) -> FingerTruth:
    """A frame without tip, one before the contact, a sample, and a sample whose truth is not known."""
    rows = ("0,0,0,1,2,3,0,-1,0,0", "1,0,0,1,2,3,0,2,0,0", "2,1,0,4,5,6,2,2,5,1.5", "3,2,0,,5,6,2,2,5,1.5")
    return finger_truth(recording(tmp_path, HEAD, *rows), ["tip"], 1)


def test_truth_is_read_in_si(truth: FingerTruth) -> None:
    assert truth.samples.tolist() == [2] and truth.point_m is not None
    np.testing.assert_allclose(truth.point_m[2], [[4e-3, 5e-3, 6e-3]])
    np.testing.assert_allclose(truth.cable_m, [0, 0, 5e-3, 5e-3])
    np.testing.assert_allclose(truth.tension_N[:, 0], [0, 0, 1.5, 1.5])
    assert truth.without_force.tolist() == [True, True, False, False]
    assert truth.without_tip.tolist() == [True, False, False, False]
    assert truth.depth_m is None


def test_electrodes_in_the_truth_go_by_number_or_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rows = [f"{k},1,0,4,5,6,2,{where},5,1.5" for k, where in enumerate(["2", "palm1", "", "-1", "plam"])]
    names = ["palm0", "palm1", "palm2"]
    truth = finger_truth(recording(tmp_path, HEAD, *rows), ["tip"], 1, names)
    assert truth.electrode[:, 0].tolist() == [2, 1, NOWHERE, NOWHERE, NOWHERE]
    assert "'true_contact0_electrode' says 'plam', which is none of palm0, palm1, palm2" in caplog.text
    called = finger_truth(recording(tmp_path, HEAD, rows[1]), ["tip"], 1, names)
    assert called.electrode.tolist() == [[1]]


def test_without_truth_nothing_is_known(tmp_path: Path) -> None:
    truth = finger_truth(recording(tmp_path, "time_s,a", "0,1"), ["tip"], 1)
    assert truth.point_m is None and not truth.samples.size and truth.force_N.shape == (1, 0)
    assert not truth.without_force.any() and np.isnan(truth.cable_m).all()
    series = FingerSeries([], 1, truth)
    assert series.shape_samples is None and series.contact_samples is None


def test_truth_of_some_points_only_is_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="lacks the columns 'true_end_x_mm', 'true_end_y_mm'"):
        finger_truth(recording(tmp_path, HEAD, "0,0,0,1,2,3,0,-1,0,0"), ["tip", "end"], 1)


def test_samples_are_compared_with_the_truth(truth: FingerTruth) -> None:
    still, pushed = [False, False], [True, False]
    seen = [
        finger_frame(tracked(at, [force, 0.0]), state(0.0, force, 0.0, 0.0), posture(x))
        for at, force, x in ((still, 0.0, 0.0), (pushed, 0.5, 0.0), (pushed, 1.0, 5e-3), (still, 0.0, 0.0))
    ]
    series = FingerSeries(seen, 1, truth)
    shape, contacts = series.shape_samples, series.contact_samples
    assert shape is not None and contacts is not None
    np.testing.assert_allclose(shape.error_m, [[np.sqrt(2) * 1e-3]])
    np.testing.assert_allclose(shape.cable_m, [5e-3])
    np.testing.assert_allclose(contacts.force_error, [[0.5]])
    np.testing.assert_allclose(series.pressure_Pa - series.misfit_Pa, 48.0)
    np.testing.assert_allclose(series.tension_N, 3.0)
    assert np.isnan(series.measured_m).all()
