"""Sparse positive weights that stand for a sum."""

import numpy as np
import pytest
from scipy.optimize import nnls

from softfuse.errors import SolveError
from softfuse.rom.sampling import compressed, empirical_cubature


def sums_of_smooth_functions(rows: int, parts: int) -> np.ndarray:
    """Values (r, e) on a line, each row a smooth function: few points integrate them all."""
    x = np.linspace(0.0, 1.0, parts)
    random = np.random.default_rng(3)
    return np.stack([np.cos(random.uniform(0, 6) * x + random.uniform(0, 6)) for _ in range(rows)])


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-4])
def test_sums_are_met_with_few_parts_and_positive_weights(tolerance) -> None:
    values = sums_of_smooth_functions(40, 500)
    found = empirical_cubature(values, tolerance=tolerance, most=100)
    total = values.sum(axis=1)
    left = values[:, found.parts] @ found.weights - total
    assert np.all(found.weights > 0) and len(np.unique(found.parts)) == len(found.parts) <= 20
    np.testing.assert_allclose(np.linalg.norm(left) / np.linalg.norm(total), found.error, rtol=1e-9)
    assert found.error <= tolerance


def test_states_between_those_of_training_are_summed_as_well() -> None:
    values = sums_of_smooth_functions(80, 400)
    found = empirical_cubature(values[:40], tolerance=1e-4, most=100)
    total = values[40:].sum(axis=1)
    left = values[40:, found.parts] @ found.weights - total
    assert np.linalg.norm(left) < 1e-2 * np.linalg.norm(total)


def test_a_tight_tolerance_ends_at_the_nonnegative_least_squares_of_scipy() -> None:
    values = np.random.default_rng(0).normal(size=(30, 60))
    values[:, 30:] *= -1.0  # no positive weights on few parts reach the sums
    found = empirical_cubature(values, tolerance=1e-14, most=60)
    _, best = nnls(values, values.sum(axis=1))
    assert found.error * np.linalg.norm(values.sum(axis=1)) <= best + 1e-9


def test_where_the_parts_do_not_suffice_the_error_says_so() -> None:
    found = empirical_cubature(sums_of_smooth_functions(40, 500), tolerance=1e-6, most=3)
    assert len(found.parts) <= 3 and found.error > 1e-6


def test_a_sketch_keeps_the_norm_of_what_is_left() -> None:
    values = sums_of_smooth_functions(3000, 80)
    sketch = compressed(values, 400)
    weights = np.random.default_rng(1).uniform(size=80)
    kept = np.linalg.norm(sketch @ weights) / np.linalg.norm(values @ weights)
    assert sketch.shape == (400, 80) and abs(kept - 1) < 0.15
    assert compressed(values[:10], 400).shape == (10, 80)


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_states_that_strain_nothing_are_refused(bad) -> None:
    with pytest.raises(SolveError, match="under load"):
        empirical_cubature(np.full((4, 9), bad), tolerance=0.1, most=5)
