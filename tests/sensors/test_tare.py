"""The zero of a pressure sensor."""

import jax
import jax.numpy as jnp
import numpy as np
from made_sensors import tare

from softfuse.sensors.tare import tare_init, tare_known, tare_update, tare_variance

TARE = tare()
NOISE = 44.0
DT = 0.01


@jax.jit
def run(pressure, at_rest, tare=TARE):
    noise = jnp.full(pressure.shape[1], NOISE)

    def step(state, frame):
        state = tare_update(tare, state, jnp.asarray(DT), frame[0], noise, frame[1])
        return state, (state.zero_Pa, jnp.sqrt(tare_variance(tare, state)), tare_known(tare, state))

    return jax.lax.scan(step, tare_init(tare, jnp.zeros(pressure.shape[1])), (pressure, at_rest))[1]


def readings(n, channels, zero=0.0, seed=0):
    return zero + NOISE * np.random.default_rng(seed).standard_normal((n, channels))


def test_the_first_readings_are_averaged_equally():
    pressure = readings(90, 3, zero=1500.0)
    zero, sigma, known = run(pressure, np.ones((90, 3), bool), tare(drift=0.0))
    # The prior, 2.5 kPa about the nominal value, weighs as much as (44/2500)² of one reading.
    mean = np.sum(pressure, axis=0) / (90 + (NOISE / 2500.0) ** 2)
    np.testing.assert_allclose(zero[-1], mean, rtol=1e-12)
    np.testing.assert_allclose(sigma[-1], NOISE / np.sqrt(90 + (NOISE / 2500.0) ** 2), rtol=1e-12)
    assert not np.any(np.asarray(known))


def test_the_zero_counts_as_known_after_the_settling_time_at_rest():
    at_rest = np.ones((400, 1), bool)
    at_rest[50:150] = False
    _, _, known = run(readings(400, 1), at_rest)
    assert np.argmax(np.asarray(known)) in (199, 200)


def test_error_is_what_sigma_says_at_the_start_later_and_after_a_long_touch():
    channels, n = 400, 4000
    rng = np.random.default_rng(1)
    drift = 2.0 * rng.standard_normal(channels)
    true = rng.uniform(-2e3, 2e3, channels) + drift * DT * np.maximum(np.arange(n) - 1500, 0)[:, None]
    at_rest = np.ones((n, channels), bool)
    at_rest[1500:3500] = False
    zero, sigma, _ = run(true + readings(n, channels, seed=2), at_rest)
    for frame in (60, 400, 1490, 3499, 3520):
        error = np.asarray(zero[frame]) - true[frame]
        assert 0.88 < np.sqrt(np.mean((error / np.asarray(sigma[frame])) ** 2)) < 1.12, frame
    # Exponential weights with the following time: half of 1 - exp(-dt/T) of the variance of one reading.
    assert float(sigma[1490, 0]) < 1.1 * NOISE * np.sqrt(0.5 * DT / 5.0)


def test_a_drift_is_followed_with_a_lag_of_the_following_time():
    n = 4000
    true = 0.6 * DT * np.arange(n)[:, None] * np.ones(40)
    zero, _, _ = run(true + readings(n, 40), np.ones((n, 40), bool))
    assert abs(np.mean(np.asarray(zero[-1]) - true[-1]) + 0.6 * 5.0) < 0.5


def test_the_zero_is_frozen_unless_at_rest():
    pressure = readings(1000, 2)
    pressure[300:] += 150.0
    at_rest = np.ones((1000, 2), bool)
    at_rest[300:, 0] = False
    zero, _, _ = run(pressure, at_rest)
    assert np.all(np.asarray(zero[299:, 0]) == float(zero[299, 0]))
    assert float(zero[-1, 1]) > 75.0


def test_an_unseen_touch_is_no_zero_but_a_jump_that_lasts_is_learnt():
    pressure = readings(1500, 2)
    pressure[400:700, 0] += 800.0
    pressure[400:, 1] += 800.0
    zero, sigma, known = run(pressure, np.ones((1500, 2), bool))
    zero, sigma, known = np.asarray(zero), np.asarray(sigma), np.asarray(known)
    assert np.max(np.abs(zero[300:, 0])) < 25.0 and known[300:, 0].all()
    assert abs(zero[890, 1]) < 25.0
    assert not known[905:995, 1].any() and known[1010:, 1].all()
    assert abs(zero[-1, 1] - 800.0) < 20.0
