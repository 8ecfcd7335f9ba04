"""Which further presses are looked at."""

import numpy as np

from softfuse.report.certainty import least_and_most


def test_actuators_are_as_they_were_in_one_sample() -> None:
    prescribed = np.array(
        [[0.0, 101325.0, 0.0], [2.0, 101325.0, 0.0], [0.0, 101325.0, 9e3], [1.0, 101325.0, 8e3]]
    )
    # All three at their largest is a pose that nobody has tried.
    assert least_and_most(prescribed).tolist() == [0, 3]


def test_one_sample_says_all_where_nothing_moves() -> None:
    assert least_and_most(np.full((4, 2), 101325.0)).tolist() == [0]
    assert least_and_most(np.zeros((3, 0))).tolist() == [0]
