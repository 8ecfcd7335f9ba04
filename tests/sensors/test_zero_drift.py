"""The Kalman filter for a wandering zero."""

import jax.numpy as jnp
import numpy as np
from made_sensors import d6f_p0001a1

from softfuse.sensors.zero_drift import observe_zero, predict_zero, zero_prior, zero_variance

DRIFT = d6f_p0001a1(1).zero_drift


def wander(rng, steps, dt, runs):
    """Sampled Ornstein-Uhlenbeck process, (steps, runs) [V]."""
    decay = np.exp(-dt / float(DRIFT.wander_time_s))
    sigma = float(DRIFT.wander_sigma_V)
    w = np.empty((steps, runs))
    w[0] = sigma * rng.standard_normal(runs)
    for i in range(1, steps):
        w[i] = decay * w[i - 1] + sigma * np.sqrt(1 - decay**2) * rng.standard_normal(runs)
    return w


def test_two_steps_are_one():
    prior = zero_prior(DRIFT, jnp.asarray([0.5, 0.5]))
    prior = observe_zero(DRIFT, prior, jnp.asarray([0.503, 0.49]), jnp.asarray([True, False]))
    whole, area = predict_zero(DRIFT, prior, jnp.asarray(0.7), jnp.asarray(7.0))
    first, area_1 = predict_zero(DRIFT, prior, jnp.asarray(0.3), jnp.asarray(3.0))
    second, area_2 = predict_zero(DRIFT, first, jnp.asarray(0.4), jnp.asarray(4.0))
    np.testing.assert_allclose(second.covariance, whole.covariance, rtol=1e-10, atol=1e-18)
    np.testing.assert_allclose(area_1 + area_2, area, rtol=1e-12)


def test_series_and_closed_form_of_the_noise_meet():
    tau = float(DRIFT.wander_time_s)
    prior = zero_prior(DRIFT, jnp.asarray([0.5]))

    def integral_variance(dt):
        later, _ = predict_zero(DRIFT, prior, jnp.asarray(dt), jnp.asarray(1.0))
        return float(later.covariance[0, 2, 2]) / dt**2

    below, above = integral_variance(0.00999 * tau), integral_variance(0.01001 * tau)
    assert abs(below - above) < 1e-4 * below


def test_covariance_is_symmetric_and_positive_after_many_updates():
    estimate = zero_prior(DRIFT, jnp.asarray([0.5]))
    rng = np.random.default_rng(1)
    for _ in range(500):
        estimate, _ = predict_zero(DRIFT, estimate, jnp.asarray(0.01), jnp.asarray(1.0))
        reading = jnp.asarray(0.5 + 2e-3 * rng.standard_normal(1))
        estimate = observe_zero(DRIFT, estimate, reading, jnp.asarray([True]))
    covariance = np.asarray(estimate.covariance[0])
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-16)
    assert np.linalg.eigvalsh(covariance / np.abs(covariance).max()).min() > -1e-10
    assert 0.05e-3 < np.sqrt(float(zero_variance(estimate)[0])) < 0.4e-3


def test_predicted_error_of_the_integral_is_the_one_that_occurs():
    rng = np.random.default_rng(7)
    runs, dt, quiet, steps = 300, 0.02, 200, 400
    zero = 0.5 + 10e-3 * rng.standard_normal(runs) + wander(rng, steps, dt, runs)
    reading = zero + 2e-3 * rng.standard_normal((steps, runs))
    estimate = zero_prior(DRIFT, jnp.full(runs, 0.5))
    use, integral = jnp.ones(runs, bool), np.zeros(runs)
    for i in range(steps):
        estimate, area = predict_zero(DRIFT, estimate, jnp.asarray(dt), jnp.asarray(1.0))
        if i < quiet:
            estimate = observe_zero(DRIFT, estimate, jnp.asarray(reading[i]), use)
            if i == quiet - 1:
                keep = jnp.asarray([1.0, 1.0, 0.0])
                covariance = estimate.covariance * keep[:, None] * keep[None, :]
                estimate = type(estimate)(estimate.bias_V, estimate.wander_V, covariance)
        else:
            integral += reading[i] * dt - np.asarray(area)
    predicted = np.sqrt(np.asarray(estimate.covariance)[:, 2, 2])
    assert 0.88 < np.sqrt(np.mean((integral / predicted) ** 2)) < 1.12
