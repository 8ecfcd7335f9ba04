"""Places that readings help to find are followed from frame to frame, and begun where readings point to."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.reading_pattern import ReadingPattern
from softfuse.estimation.sought_places import SoughtPlaces
from softfuse.functional.chart import FlatChart
from softfuse.functional.workspace import FlatWorkspace
from softfuse.mechanics.model import compliance

YES, NO = np.array([True]), np.array([False])
ROOM = np.full((1, 2), -0.02), np.full((1, 2), 0.03)
SIGMA = np.array([[1e-3, 2e-3]])


def test_a_place_is_held_until_there_is_a_force() -> None:
    first = SoughtPlaces.none(1).next(YES, NO, np.zeros(1), ROOM).begun_at(0, np.array([0.01, 0.02]))
    held = first.prior(SIGMA, ROOM)
    assert not held.spread.any() and not held.offset.any()
    np.testing.assert_array_equal(first.found(np.ones((1, 2))).offset_m, [[0.01, 0.02]])
    pressed = first.next(YES, NO, np.array([2.0]), ROOM)
    free = pressed.prior(SIGMA, ROOM)
    np.testing.assert_array_equal(free.spread, np.diag(SIGMA[0]))
    np.testing.assert_array_equal(free.offset, [[0.01, 0.02]])
    np.testing.assert_array_equal(pressed.found(np.full((1, 2), 0.5)).offset_m, [[0.5, 0.5]])


def test_a_place_stays_in_the_room_that_it_has() -> None:
    begun = SoughtPlaces.none(1).next(YES, NO, np.zeros(1), ROOM).begun_at(0, np.array([0.0295, -0.05]))
    next_one = begun.next(YES, NO, np.ones(1), ROOM)
    np.testing.assert_array_equal(next_one.offset_m, [[0.0295, -0.02]])
    prior = next_one.prior(SIGMA, ROOM)
    np.testing.assert_allclose(prior.low, [[-3e-3, 0.0]])
    np.testing.assert_allclose(prior.high, [[0.5e-3, 3e-3]])


@pytest.mark.parametrize("next_one", [(NO, NO), (YES, YES)])
def test_what_goes_or_comes_into_sight_begins_where_it_is_seen(next_one) -> None:
    unseen = SoughtPlaces.none(1).next(YES, NO, np.ones(1), ROOM).begun_at(0, np.array([0.01, 0.02]))
    np.testing.assert_array_equal(unseen.next(*next_one, np.ones(1), ROOM).offset_m, [[0.0, 0.0]])


@pytest.fixture(scope="module")
def pattern(plain_device) -> ReadingPattern:
    ends = np.array([[-16e-3, -6e-3], [16e-3, 6e-3]])
    return ReadingPattern.of(plain_device, FlatWorkspace(FlatChart.along((0, 0, -1)), *ends), side=3)


def test_the_pattern_is_what_small_forces_do(plain_device, pattern: ReadingPattern) -> None:
    assert pattern.place.shape == (9, 3, 3) and pattern.slope.shape == (9, 2)
    slope = eqx.filter_jit(compliance)
    for place, found in zip(pattern.place, pattern.slope, strict=True):
        wanted = slope(plain_device, jnp.asarray(place)[None], jnp.array([1e-6]))[:, 0]
        np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_a_search_begins_anew_only_where_readings_say_so_clearly(pattern: ReadingPattern) -> None:
    left, right = pattern.place[1], pattern.place[7]
    reading, valid = 4.0 * pattern.slope[7], np.ones(2, bool)
    sure, unsure = (np.diag((part * np.abs(reading).max() * np.ones(2)) ** 2) for part in (0.001, 10.0))
    found = pattern.fitted(reading, sure, valid).better(left)
    assert found is not None and abs(found[0, 0] - right[0, 0]) < 1e-9
    assert pattern.fitted(reading, sure, valid).better(found) is None
    assert pattern.fitted(reading, unsure, valid).better(left) is None
    # A cavity that is not known tells nothing.
    one = pattern.fitted(np.array([np.nan, reading[1]]), sure, np.array([False, True]))
    assert one.better(left) is None


def test_readings_of_no_press_point_nowhere(pattern: ReadingPattern) -> None:
    still = np.array([1e-9, 1e-9])  # both cavities grow
    fit = pattern.fitted(still, np.diag(still**2), np.ones(2, bool))
    assert fit.better(pattern.place[0]) is None
    np.testing.assert_array_equal(fit.force_N, 0.0)


def test_what_else_explains_the_readings_counts(pattern: ReadingPattern) -> None:
    """One cavity tells a force at each place: all are as likely."""
    reading, valid = 4.0 * pattern.slope[7], np.array([False, True])
    fit = pattern.fitted(reading, np.diag(np.full(2, 1e-20)), valid)
    np.testing.assert_allclose(fit.missing, fit.missing[0], atol=1e-9)
    np.testing.assert_allclose(fit.force_N, reading[1] / pattern.slope[:, 1])
    middle = fit.elsewhere(pattern.place[4], 4.0)
    assert middle.share == 0.0 and not middle.place_m2.any()  # all are its neighbours
    corner = fit.elsewhere(pattern.place[0], 4.0)
    far = np.setdiff1d(np.arange(9), [0, 1, 3, 4])
    np.testing.assert_allclose(corner.share, 5 / 9)
    squares = (pattern.place[far, 0, :2] - pattern.place[0, 0, :2]) ** 2
    np.testing.assert_allclose(corner.place_m2, squares.mean(axis=0))
    np.testing.assert_allclose(corner.force_N2, np.mean((fit.force_N[far] - 4.0) ** 2))
