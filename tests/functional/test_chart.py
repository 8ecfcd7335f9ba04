"""Places have orthonormal frames whose cross product is the outward normal, and move along them."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.functional.chart import FlatChart, direction_of, facing, moved, nearest

AXES = [tuple(sign * axis) for axis in np.eye(3) for sign in (1, -1)]
OBLIQUE = [tuple(np.array(signs) * (2.0, 0.7, 1.1)) for signs in itertools.product((1, -1), repeat=3)]
TIED = [(1.0, 1.0, 0.0), (-1.0, 0.0, 1.0), (1.0, -1.0, 1.0)]
DIRECTIONS = [*AXES, *OBLIQUE, *TIED]
POINTS = 1e-3 * np.random.default_rng(1).normal(size=(4, 5, 3))


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_place_is_a_point_with_tangents_against_whose_cross_product_it_is_pressed(direction) -> None:
    places = facing(POINTS, direction)
    assert places.shape == (4, 5, 3, 3)
    np.testing.assert_array_equal(places[..., 0, :], POINTS)
    u, v = places[..., 1, :], places[..., 2, :]
    into = np.array(direction) / np.linalg.norm(direction)
    frame = np.stack([u, v, np.cross(u, v)], axis=-2)
    np.testing.assert_allclose(
        frame @ np.swapaxes(frame, -1, -2), np.broadcast_to(np.eye(3), frame.shape), atol=1e-15
    )
    np.testing.assert_allclose(np.cross(u, v), np.broadcast_to(-into, u.shape), atol=1e-15)
    np.testing.assert_allclose(direction_of(jnp.asarray(places)), np.broadcast_to(into, u.shape), atol=1e-15)


@pytest.mark.parametrize("length", [1e-6, 5.0])
def test_how_long_a_direction_is_does_not_matter(length: float) -> None:
    np.testing.assert_allclose(
        facing(POINTS, length * np.array(OBLIQUE[1])), facing(POINTS, OBLIQUE[1]), atol=1e-15
    )


def test_what_is_pressed_downwards_has_the_tangents_x_and_y() -> None:
    np.testing.assert_array_equal(facing(np.zeros(3), (0, 0, -1)), [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("direction", AXES)
def test_along_an_axis_coordinates_are_the_two_others(direction) -> None:
    chart = FlatChart.along(direction)
    across = np.flatnonzero(np.array(direction) == 0)
    np.testing.assert_array_equal(chart.axes, np.eye(3)[across])
    np.testing.assert_array_equal(chart.coordinates(facing(POINTS, direction)), POINTS[..., across])


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_coordinates_name_places_and_places_have_coordinates(direction) -> None:
    chart, at = FlatChart.along(direction), POINTS[..., :2]
    places = chart.place(jnp.asarray(at))
    assert places.shape == (4, 5, 3, 3)
    np.testing.assert_allclose(chart.coordinates(np.asarray(places)), at, atol=1e-16)
    np.testing.assert_allclose(places, facing(np.asarray(places[..., 0, :]), direction), atol=1e-15)
    # Across the direction nothing is lost, along it everything.
    np.testing.assert_allclose(places[..., 0, :] @ chart.direction, 0.0, atol=1e-16)
    np.testing.assert_allclose(np.linalg.norm(places[..., 0, :], axis=-1), np.linalg.norm(at, axis=-1))


def test_a_chart_may_begin_anywhere() -> None:
    plain = FlatChart.along((1.0, 0.0, 0.0))
    chart = FlatChart(jnp.array([3.0, 1.0, 2.0]), plain.axes, plain.direction)
    np.testing.assert_array_equal(chart.place(jnp.zeros(2))[0], [3.0, 1.0, 2.0])
    np.testing.assert_array_equal(
        chart.coordinates(np.asarray(chart.place(jnp.array([0.5, -0.25])))), [0.5, -0.25]
    )


@pytest.mark.parametrize("direction", [(0, 0, -1), OBLIQUE[3]])
def test_a_moved_place_is_off_along_its_tangents_which_stay(direction) -> None:
    places, offset = facing(POINTS, direction), 1e-3 * np.random.default_rng(2).normal(size=(4, 5, 2))
    found = moved(places, offset)
    assert isinstance(found, np.ndarray)
    expected = POINTS + offset[..., :1] * places[0, 0, 1] + offset[..., 1:] * places[0, 0, 2]
    np.testing.assert_allclose(found[..., 0, :], expected, atol=1e-17)
    np.testing.assert_array_equal(found[..., 1:, :], places[..., 1:, :])
    np.testing.assert_allclose(moved(found, -offset), places, atol=1e-17)
    np.testing.assert_array_equal(moved(places, np.zeros(2)), places)


def test_a_place_moves_in_programs_and_with_derivatives() -> None:
    place = jnp.asarray(facing(POINTS[0, 0], OBLIQUE[0]))
    slope = jax.jit(jax.jacfwd(lambda offset: moved(place, offset)))(jnp.zeros(2))
    np.testing.assert_allclose(slope[0].T, place[1:], atol=1e-15)
    np.testing.assert_array_equal(slope[1:], 0.0)


def test_the_nearest_place_is_that_of_the_nearest_point() -> None:
    places = np.concatenate([facing(1e-2 * np.eye(3), (0, 0, -1)), facing(np.zeros((1, 3)), (0, 1, 0))])
    at = facing(np.array([[9e-3, 1e-3, 0], [1e-3, 0, 7e-3], [2e-3, 3e-3, 0], [0, 1.1e-2, 0]]), (1, 0, 0))
    np.testing.assert_array_equal(nearest(places, at), [0, 2, 3, 1])
    np.testing.assert_array_equal(nearest(places, at[1]), 2)
    np.testing.assert_array_equal(nearest(places, at.reshape(2, 2, 3, 3)), [[0, 2], [3, 1]])
