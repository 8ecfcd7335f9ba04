"""Places that readings help to find are followed from frame to frame."""

import numpy as np
import pytest

from softfuse.estimation.place_search import SoughtPlaces

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
