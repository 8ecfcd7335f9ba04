"""Table III from positions whose errors are known."""

import numpy as np
import pytest

from softfuse.experiment.accuracy import ShapeSamples, position_table


@pytest.fixture
def samples() -> ShapeSamples:
    """Rows of two points: 1 and 2 mm off without the cable, 3 and 4 mm with it, one row unknown."""
    true = np.zeros((5, 2, 3))
    found = true.copy()
    found[:2] += 1e-3 * np.array([[1.0, 0, 0], [0, 2.0, 0]])
    found[2:4] += 1e-3 * np.array([[0, 0, 3.0], [4.0, 0, 0]])
    found[4] = np.nan
    cable = np.array([0.0, 0.0, 0.01, 0.01, np.nan])
    return ShapeSamples(np.zeros(5, int), np.array([1, 2, 1, 2, 1]), cable, found, true)


def test_errors_are_averaged_by_group_and_by_point(samples: ShapeSamples) -> None:
    table = position_table(samples, ["p0", "p1"])
    expected = {"all": 2.5, "with_cable": 3.5, "without_cable": 1.5, "p0": 2.0, "p1": 3.0, "level_2": 2.5}
    for name, mean in expected.items():
        assert table[name].mean == pytest.approx(1e-3 * mean)
    assert table["all"].n == 8 and table["p0"].n == 4 and table["level_1"].n == 4
