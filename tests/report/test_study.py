"""Which shapes of a recording are kept, and which contact is which."""

from typing import Any

import numpy as np
import pytest
from checks import stand_in

from softfuse.report.study import Peaks
from softfuse.report.truth import matched_contacts


def test_each_run_keeps_the_shape_at_its_peak() -> None:
    sizes = [(0, 0.0), (1, np.nan), (1, 2.0), (1, np.nan), (1, 5.0), (1, 1.0), (0, 0.0), (1, 3.0), (1, 0.0)]
    peaks, estimate = Peaks(), [stand_in() for _ in sizes]
    for frame, (going, size) in enumerate(sizes):
        now: Any = estimate[frame]
        peaks.see(frame, going > 0, size, now)
    assert [(peak.frame, peak.size) for peak in peaks.kept] == [(4, 5.0), (7, 3.0)]
    assert [peak.estimate for peak in peaks.kept] == [estimate[4], estimate[7]]


def found(places: list[list[float]], touching: list[bool]) -> Any:
    """A frame with contacts at places in mm."""
    count = len(places)
    return stand_in(
        touching=np.array(touching),
        location_m=1e-3 * np.array(places),
        axis_sigma_m=np.full((count, 3), 1e-4),
        contact_force_N=np.arange(1.0, count + 1),
        contact_sigma_N=np.full(count, 0.1),
    )


def truth(rows: list[tuple[int, float, float, float, float]]) -> Any:
    """Levels, x and force of two contacts; y is 0."""
    table = np.array(rows, float)
    columns = {
        "a0_x_mm": table[:, 1],
        "a0_force_N": table[:, 2],
        "a1_x_mm": table[:, 3],
        "a1_force_N": table[:, 4],
    }
    columns |= {f"a{k}_y_mm": np.zeros(len(table)) for k in range(2)}
    return stand_in(columns=columns, level=table[:, 0].astype(int), get=columns.__getitem__)


def test_contacts_are_matched_with_those_that_are_nearest() -> None:
    frames = [
        found([[10.0, 0, 18], [-10.0, 1, 18]], [True, True]),
        found([[10.0, 0, 18], [-10.0, 0, 18]], [True, True]),
        found([[10.0, 0, 18], [90.0, 0, 18]], [True, True]),
    ]
    # The second frame does not count; in the third one is found where nothing presses.
    known = truth([(1, -10, 2.0, 11, 1.0), (0, -10, 2.0, 11, 1.0), (2, -10, 2.0, 11, 1.0)])
    matched = matched_contacts(frames, known, ("a0", "a1"))
    assert matched is not None and matched.missed == 1 and matched.misplaced == 1
    samples = matched.samples
    assert samples.level.tolist() == [1, 1, 2, 2]
    np.testing.assert_array_equal(samples.force_N, [2.0, 1.0, np.nan, 1.0])
    np.testing.assert_allclose(samples.location_error_m, [1e-3, 1e-3, np.nan, 1e-3])


def test_without_truth_of_each_there_is_nothing_to_match() -> None:
    nothing: Any = stand_in(columns={}, level=np.ones(1, int))
    assert matched_contacts([], nothing, ("a0",)) is None


@pytest.mark.parametrize("force", [0.0, np.nan])
def test_what_does_not_press_is_not_matched(force: float) -> None:
    known = truth([(1, -10, force, 11, force)])
    assert matched_contacts([found([[10.0, 0, 18]], [True])], known, ("a0", "a1")) is None
