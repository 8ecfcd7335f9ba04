"""The field under and beside the indenter's wall."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root_scalar

from softfuse.sensors.crossed.diamond_array import disc_density, wall_density


def exact(xi: float) -> float:
    bracket = (1e-6, 1.0 - 1e-15)
    return root_scalar(lambda k: 1.0 / k - np.arctanh(k) - xi, bracket=bracket, xtol=1e-15).root


@pytest.mark.parametrize("xi", [-12.0, -3.0, -0.5, 0.0, 0.2, 1.0, 5.0, 80.0])
def test_density_solves_its_equation(xi):
    assert float(wall_density(jnp.asarray(xi))) == pytest.approx(exact(xi), abs=2e-8)


def test_density_has_the_limits_of_a_plate_and_of_a_wedge():
    assert float(wall_density(jnp.asarray(-40.0))) == pytest.approx(1.0, abs=1e-12)
    assert float(wall_density(jnp.asarray(1e4))) == pytest.approx(1e-4, rel=1e-6)


def test_derivative_agrees_with_finite_differences_in_both_modes():
    xi = jnp.linspace(-4.0, 20.0, 49)
    h = 1e-4
    difference = (wall_density(xi + h) - wall_density(xi - h)) / (2.0 * h)
    _, forward = jax.jvp(wall_density, (xi,), (jnp.ones_like(xi),))
    reverse = jax.grad(lambda x: jnp.sum(wall_density(x)))(xi)
    np.testing.assert_allclose(forward, difference, atol=1e-6)
    np.testing.assert_allclose(reverse, forward, atol=1e-14)


def test_density_of_a_disc_is_continuous_at_its_wall_and_falls_monotonically():
    rho = jnp.linspace(1e-4, 60e-3, 4000)
    density = np.asarray(disc_density(rho, jnp.asarray(10e-3), jnp.full(4000, 1e-3)))
    assert np.all(np.diff(density) <= 1e-12)
    assert np.max(np.abs(np.diff(density))) < 0.02
