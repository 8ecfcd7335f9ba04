"""Programmes: tables that are interpolated and repeated."""

import numpy as np

from softfuse.experiment.performance import Programme


def test_between_rows_it_is_interpolated_and_marks_hold() -> None:
    table = Programme(
        0.1, ("a", "b"), np.array([[0.0, 4.0], [1.0, 2.0], [3.0, 0.0]]),
        {"press": np.array([0.0, 0.0, 1.0]), "true_force_N": np.array([0.0, 2.0, 4.0])}, frozenset({"press"}),
    )  # fmt: skip
    times = np.array([0.0, 0.05, 0.1, 0.25, 0.29, 0.3, 0.42])
    values = [[0, 4], [0.5, 3], [1, 2], [1.5, 2], [0.3, 3.6], [0, 4], [1.4, 1.6]]
    np.testing.assert_allclose(table.at(times), values, atol=1e-12)
    truth = table.truth_at(times)
    np.testing.assert_allclose(truth["true_force_N"], [0, 1, 2, 2, 0.4, 0, 2.4], atol=1e-12)
    np.testing.assert_array_equal(truth["press"], [0, 0, 0, 1, 1, 0, 0])
    assert table.only(["b"]).at(times).tolist() == table.at(times)[:, [1]].tolist()


def test_it_repeats() -> None:
    table = Programme(0.1, ("a",), np.array([[0.0], [1.0], [3.0]]), {})
    times = np.array([0.05, 0.2, 0.25])
    np.testing.assert_allclose(table.at(times + 7 * table.period_s), table.at(times), rtol=1e-9)
    np.testing.assert_allclose(table.at(times + 1e6 * table.period_s), table.at(times), rtol=1e-6)
