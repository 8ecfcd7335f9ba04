"""A workspace tells how far places may move in it, and has a grid of places all over it."""

import itertools

import numpy as np
import pytest

from softfuse.functional.chart import FlatChart, direction_of, facing, moved
from softfuse.functional.workspace import FlatWorkspace

LOW, HIGH = np.array([-0.03, -0.01]), np.array([0.02, 0.04])
DIRECTIONS = [
    *(tuple(sign * axis) for axis in np.eye(3) for sign in (1, -1)),
    *(tuple(np.array(signs) * (2.0, 0.7, 1.1)) for signs in itertools.product((1, -1), repeat=3)),
]


@pytest.fixture(params=DIRECTIONS)
def workspace(request: pytest.FixtureRequest) -> FlatWorkspace:
    return FlatWorkspace(FlatChart.along(request.param), LOW, HIGH)


def test_at_the_ends_of_its_room_a_place_is_at_an_edge(workspace: FlatWorkspace) -> None:
    """Also where a tangent runs against the axis, and for a place outside, whose room is all beside it."""
    at = np.array([[0.0, 0.0], [-0.03, 0.04], [0.03, 0.01]])
    places = facing(at @ np.asarray(workspace.chart.axes), np.asarray(workspace.chart.direction))
    least, most = workspace.room(places)
    assert least.shape == most.shape == (3, 2) and np.all(least <= most)
    ends = np.stack([workspace.chart.coordinates(moved(places, end)) for end in (least, most)])
    np.testing.assert_allclose(ends.min(axis=0), np.tile(LOW, (3, 1)), atol=1e-16)
    np.testing.assert_allclose(ends.max(axis=0), np.tile(HIGH, (3, 1)), atol=1e-16)
    assert np.all(least[0] < 0) and np.all(most[0] > 0)
    assert least[2, 0] < most[2, 0] < 0 or 0 < least[2, 0] < most[2, 0]


def test_where_it_is_pressed_downwards_room_is_along_x_and_y() -> None:
    workspace = FlatWorkspace(FlatChart.along((0, 0, -1)), LOW, HIGH)
    least, most = workspace.room(facing(np.array([[0.01, 0.01, 0.5]]), (0, 0, -1)))
    np.testing.assert_allclose(least, [[-0.04, -0.02]], atol=1e-17)
    np.testing.assert_allclose(most, [[0.01, 0.03]], atol=1e-17)


def test_a_grid_reaches_from_edge_to_edge_in_equal_steps(workspace: FlatWorkspace) -> None:
    places, pitch = workspace.grid(6)
    assert places.shape == (36, 3, 3)
    np.testing.assert_allclose(pitch, (HIGH - LOW) / 5)
    at = workspace.chart.coordinates(places)
    every = itertools.product(np.linspace(LOW[0], HIGH[0], 6), np.linspace(LOW[1], HIGH[1], 6))
    np.testing.assert_allclose(at, np.array(list(every)), atol=1e-16)
    np.testing.assert_allclose(direction_of(places), np.tile(workspace.chart.direction, (36, 1)), atol=1e-15)
