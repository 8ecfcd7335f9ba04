"""What the model misses while nothing is near: kept, scaled with the strokes, learned where seen."""

import numpy as np

from softfuse.estimation.model_error import ModelOffset

MISFIT, KNOWN = np.array([4.0, -6.0]), np.array([True, True])


def test_nothing_learned_is_nothing_missed() -> None:
    none = ModelOffset.none(2)
    assert list(none.at(0.0)) == [0.0, 0.0] and list(none.at(5e-3)) == [0.0, 0.0]


def test_it_grows_with_the_strokes_but_not_for_ever() -> None:
    offset = ModelOffset.none(2).learned(MISFIT, KNOWN, 5e-3, 1.0)
    np.testing.assert_allclose(offset.at(5e-3), MISFIT)
    np.testing.assert_allclose(offset.at(2.5e-3), MISFIT / 2)
    np.testing.assert_allclose(offset.at(0.0), 0.0)
    np.testing.assert_allclose(offset.at(1.0), 2 * MISFIT)


def test_without_a_stroke_it_is_the_zero_of_the_sensors() -> None:
    for stroke in (0.0, 1e-18):  # as rounding leaves it
        offset = ModelOffset.none(2).learned(MISFIT, KNOWN, stroke, 1.0)
        np.testing.assert_allclose(offset.at(0.0), MISFIT)
        np.testing.assert_allclose(offset.at(1e-2), MISFIT)


def test_a_reading_that_is_lost_keeps_what_was_known_of_it() -> None:
    offset = ModelOffset.none(2).learned(MISFIT, KNOWN, 5e-3, 1.0)
    later = offset.learned(np.array([np.nan, 1.0]), np.array([False, True]), 10e-3, 1.0)
    np.testing.assert_allclose(later.at(10e-3), [8.0, 1.0])


def test_noise_is_averaged_while_the_strokes_change() -> None:
    """A misfit of 1 per mm with noise of 1, read for 10 s while the stroke grows: within a fraction of it."""
    rng, offset = np.random.default_rng(0), ModelOffset.none(2)
    for stroke in np.linspace(0.0, 10e-3, 1000):
        misfit = 1e3 * stroke + rng.normal(size=2)
        offset = offset.learned(misfit, KNOWN, float(stroke), 0.01)
    np.testing.assert_allclose(offset.at(10e-3), 10.0, atol=0.5)
