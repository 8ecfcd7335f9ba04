"""Moments of truncated normal distributions against scipy's."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import truncnorm

from softfuse.sensors.contact_places import within

BOX = jnp.array([[-0.03, -0.02], [0.03, 0.02]])


def test_moments_are_those_of_a_truncated_normal_distribution() -> None:
    rng = np.random.default_rng(0)
    place = rng.uniform(-0.035, 0.035, (50, 2))
    sigma = 10 ** rng.uniform(-3, -1.5, (50, 2))
    may, mean, spread = within(jnp.asarray(place), jnp.asarray(sigma), BOX)
    low, high = np.asarray(BOX)
    far = np.any((low - place > 3 * sigma) | (place - high > 3 * sigma), axis=1)
    np.testing.assert_array_equal(may, ~far)
    exact = truncnorm((low - place) / sigma, (high - place) / sigma, loc=place, scale=sigma)
    np.testing.assert_allclose(mean[~far], exact.mean()[~far], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(spread[~far], exact.std()[~far], rtol=1e-6)
    assert np.all(np.isnan(mean[far])) and far.any() and not far.all()


def test_what_lies_well_inside_is_left_as_it_is() -> None:
    place, sigma = jnp.array([[0.01, -0.005]]), jnp.array([[1e-4, 2e-4]])
    may, mean, spread = within(place, sigma, BOX)
    assert bool(may[0])
    np.testing.assert_allclose(mean, place, rtol=1e-12)
    np.testing.assert_allclose(spread, sigma, rtol=1e-9)


def test_derivatives_are_finite_wherever_a_place_is_and_where_none_is() -> None:
    def both(place, sigma):
        return jnp.nan_to_num(jnp.stack(within(place[None], sigma[None], BOX)[1:]))

    for at in ([0.0, 0.0], [0.0325, 0.0], [0.5, 0.5]):
        for sigma in ([1e-3, 1e-5], [1e3, 1e-3], [jnp.nan, jnp.nan]):
            for derivative in (jax.jacfwd, jax.jacrev):
                slopes = derivative(both, argnums=(0, 1))(jnp.array(at), jnp.array(sigma))
                assert all(np.all(np.isfinite(slope)) for slope in slopes), (at, sigma)


def test_a_place_that_nobody_knows_is_nowhere() -> None:
    place = jnp.zeros((2, 2))
    may, mean, spread = within(place, jnp.array([[jnp.nan, 1e-3], [0.0, 1e-3]]), BOX)
    assert not np.any(may) and np.all(np.isnan(mean)) and np.all(np.isnan(spread))
