"""The paper's Tables I and II from samples whose errors are known."""

import dataclasses

import numpy as np
import pytest

from softfuse.experiment.accuracy import Samples, coverage, force_table, location_table, together

TRUE = 1e-3 * np.array([[0.0, 0.0], [28.0, 0.0], [25.0, 25.0], [3.0, 4.0]])


@pytest.fixture
def samples() -> Samples:
    """Off by 1, 2, 3 mm and 10, 20, 30 %; the last one has no estimate; the third lies outside the circle."""
    off = 1e-3 * np.array([[1.0, 0.0], [0.0, -2.0], [3.0, 0.0], [np.nan, np.nan]])
    force = np.array([5.0, 10.0, 15.0, 5.0])
    return Samples(
        level=np.array([1, 2, 3, 1]),
        location_m=TRUE + off,
        force_N=force * [1.1, 0.8, 1.3, np.nan],
        true_location_m=TRUE,
        true_force_N=force,
        location_sigma_m=1e-3 * np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0], [np.nan, np.nan]]),
        force_sigma_N=np.array([0.31, 1.0, 3.0, np.nan]),
    )


def test_location_errors_by_group(samples: Samples) -> None:
    table = location_table(samples)
    assert list(table) == ["all", "circle", "level_1", "level_2", "level_3"]
    assert table["all"].mean == pytest.approx(2e-3) and table["all"].n == 3
    assert table["all"].std == pytest.approx(np.std([1e-3, 2e-3, 3e-3]))
    assert table["circle"].mean == pytest.approx(1.5e-3) and table["circle"].n == 2
    assert table["level_1"].n == 1


def test_force_errors_by_group(samples: Samples) -> None:
    table = force_table(samples)
    assert table["all"].mean == pytest.approx(0.2)
    assert table["circle"].mean == pytest.approx(0.15)
    assert table["level_3"].mean == pytest.approx(0.3)


def test_a_group_without_estimates_says_so(samples: Samples) -> None:
    nothing = dataclasses.replace(
        samples, location_m=samples.location_m * np.nan, force_N=samples.force_N * np.nan
    )
    assert force_table(nothing)["all"].n == 0 and np.isnan(force_table(nothing)["all"].mean)
    assert np.isnan(coverage(nothing)["force"])


def test_coverage_counts_the_truth_within_the_90_percent_interval(samples: Samples) -> None:
    # Off by 1, 0, 3 of 1 mm along x, by 0, 2, 0 along y, by 0.5 of 0.31 N, 2 of 1 N, 4.5 of 3 N.
    assert coverage(samples) == pytest.approx({"force": 2 / 3, "x": 2 / 3, "y": 2 / 3})


def test_samples_are_parted_and_put_together(samples: Samples) -> None:
    parts = [samples.only(samples.level == k) for k in (1, 2, 3)]
    assert [len(part.level) for part in parts] == [2, 1, 1]
    whole = together(parts)
    np.testing.assert_array_equal(whole.level, [1, 1, 2, 3])
    np.testing.assert_array_equal(whole.true_location_m, TRUE[[0, 3, 1, 2]])
    assert force_table(whole)["all"].mean == pytest.approx(force_table(samples)["all"].mean)
