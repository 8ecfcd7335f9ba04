"""The lines of diamonds: geometry and quadrature."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.sensors.crossed.diamond_array import (
    array_points,
    array_response,
    array_slopes,
    disc_density,
    line_points,
)

LINES = (-28.0 + 8.0 * np.arange(8)) * 1e-3
PITCH = 8e-3
ZERO = jnp.asarray(0.0)
STRIPS = -8 * 4  # points of a strip: four along each of the lines that it crosses


@jax.jit
def response_of(location, row_depth=1.5e-3, column_depth=1e-3, row_rim=0.0, column_rim=0.0):
    lines = jnp.asarray(LINES)
    points = array_points(lines, lines, jnp.asarray(row_rim), jnp.asarray(column_rim))
    depth = jnp.repeat(jnp.stack([jnp.asarray(row_depth), jnp.asarray(column_depth)]), 8)
    return array_response(points, jnp.asarray(location), jnp.asarray(10e-3), depth)


def brute_force(location, depth, cell=0.1e-3):
    """Response of the columns on a fine grid; a cell belongs to the diamond in which its middle lies."""
    middle = np.arange(-32e-3 + cell / 2, 32e-3, cell)
    x, y = np.meshgrid(middle, middle, indexing="ij")
    line = np.clip(((x + 32e-3) // PITCH).astype(int), 0, 7)
    from_row = np.abs((y + 32e-3) % PITCH - PITCH / 2)
    inside = np.abs(x - LINES[line]) < from_row
    rho = np.hypot(x - location[0], y - location[1]).ravel() + 1e-9
    density = disc_density(jnp.asarray(rho), jnp.asarray(10e-3), jnp.full(rho.size, depth))
    density = np.asarray(density).reshape(x.shape)
    charge = [(density * (inside & (line == k))).sum() * cell**2 for k in range(8)]
    return np.array(charge) * 2.0 / (np.pi * PITCH**2)


def test_rows_and_columns_share_the_array_evenly():
    points = line_points(jnp.asarray(LINES), jnp.asarray(LINES), ZERO)
    across, along, area = (np.asarray(each)[:, :STRIPS] for each in points)
    np.testing.assert_allclose(area.sum(axis=1), 0.5 * 8e-3 * 64e-3, rtol=1e-12)
    assert np.abs(across).max() < 32e-3 and np.abs(along).max() < 32e-3
    own_distance = np.abs(across - LINES[:, None])
    crossing_distance = np.min(np.abs(along[..., None] - LINES), axis=-1)
    assert np.all(own_distance <= crossing_distance + 1e-12)


@pytest.mark.parametrize(
    "location", [(0.0, 0.0), (3.3e-3, -7.9e-3), (28e-3, 28e-3), (-31e-3, 12e-3), (15.5e-3, -30e-3)]
)
def test_quadrature_agrees_with_a_fine_grid(location):
    response = response_of(location)
    expected = brute_force(location, 1e-3)
    np.testing.assert_allclose(response[8:], expected, atol=0.015 * expected.max())


def test_rows_are_columns_turned_by_a_right_angle():
    here = response_of((5e-3, -22e-3), 1e-3, 1e-3)
    turned = response_of((-22e-3, 5e-3), 1e-3, 1e-3)
    np.testing.assert_allclose(here[:8], turned[8:], rtol=1e-12)
    np.testing.assert_allclose(here[8:], turned[:8], rtol=1e-12)


def test_only_the_outermost_lines_gain_from_the_rim():
    location = (0.0, 25e-3)
    gain = response_of(location, row_rim=0.5e-3) - response_of(location)
    np.testing.assert_allclose(gain[1:7], 0.0, atol=1e-15)
    np.testing.assert_allclose(gain[8:], 0.0, atol=1e-15)
    assert float(gain[7]) > float(gain[0]) > 0.0
    _, _, area = line_points(jnp.asarray(LINES), jnp.asarray(LINES), jnp.asarray(0.5e-3))
    np.testing.assert_allclose(area[:, STRIPS:].sum(), 2 * 0.5 * 0.5e-3 * 64e-3, rtol=1e-12)


def test_unequal_numbers_of_lines_are_allowed():
    x, y = jnp.linspace(-10e-3, 10e-3, 5), jnp.linspace(-20e-3, 20e-3, 3)
    points = array_points(y, x, ZERO, ZERO)
    response = array_response(points, jnp.zeros(2), jnp.asarray(4e-3), jnp.full(8, 1e-3))
    assert response.shape == (8,)
    np.testing.assert_allclose(response[:3], response[:3][::-1], rtol=1e-12)
    np.testing.assert_allclose(response[3:], response[3:][::-1], rtol=1e-12)
    assert int(jnp.argmax(response[3:])) == 2


@pytest.mark.parametrize("location", [(0.3e-3, 5.1e-3), (28e-3, -30e-3)])
def test_slopes_are_the_derivatives_of_the_response(location):
    lines, rim = jnp.asarray(LINES), jnp.asarray(0.5e-3)
    points = array_points(lines, lines, rim, ZERO)
    depth = jnp.repeat(jnp.asarray([1.5e-3, 1e-3]), 8)

    def response(q):
        return array_response(points, q[:2], q[2], depth + q[3])

    q = jnp.asarray([*location, 9.7e-3, 0.1e-3])
    found, slopes = array_slopes(points, q[:2], q[2], depth + q[3])
    np.testing.assert_allclose(found, response(q), rtol=1e-13)
    expected = jax.jacfwd(response)(q)
    np.testing.assert_allclose(slopes, expected, atol=1e-12 * float(jnp.abs(expected).max()))
    assert float(jnp.abs(expected).max()) > 10.0
