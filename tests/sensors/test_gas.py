"""Pressure in a sealed cavity to volume change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.sensors.pressure.sensor import volume_change_of

VOLUME = jnp.asarray([1265e-9, 4704e-9, 1300e-9])
P0 = 101325.0


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_pressure_and_volume_are_inverse_to_each_other(exponent):
    gauge = jnp.asarray(np.random.default_rng(0).uniform(-0.6, 3.0, (1000, 3))) * P0
    change = volume_change_of(gauge, VOLUME, P0, exponent)
    back = P0 * np.expm1(-exponent * np.log1p(change / VOLUME))
    np.testing.assert_allclose(back, gauge, rtol=1e-12, atol=1e-12 * P0)


def test_pressures_near_zero_lose_no_digits():
    gauge = jnp.asarray([1e-3, -1e-5, 1e-9])
    change = volume_change_of(gauge, VOLUME, P0, 1.4)
    back = P0 * np.expm1(-1.4 * np.log1p(change / VOLUME))
    np.testing.assert_allclose(back, gauge, rtol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_absolute_pressure_times_volume_to_the_exponent_is_constant(exponent):
    gauge = jnp.asarray([5e3, -20e3, 60e3])
    volume = VOLUME + volume_change_of(gauge, VOLUME, 95e3, exponent)
    np.testing.assert_allclose((95e3 + gauge) * volume**exponent, 95e3 * VOLUME**exponent, rtol=1e-13)


def test_twice_the_absolute_pressure_halves_the_volume():
    for exponent in (1.0, 1.4):
        gauge = jnp.full(3, P0 * (2**exponent - 1))
        change = volume_change_of(gauge, VOLUME, P0, exponent)
        np.testing.assert_allclose(change, -0.5 * VOLUME, rtol=1e-14)


def test_small_signals_have_the_closed_form_slope_and_a_squeezed_cavity_is_negative():
    slope = jax.vmap(jax.grad(lambda p, v: volume_change_of(p, v, P0, 1.4)))(jnp.zeros(3), VOLUME)
    np.testing.assert_allclose(slope, -VOLUME / (1.4 * P0), rtol=1e-14)
    assert np.all(np.asarray(volume_change_of(jnp.full(3, 100.0), VOLUME, P0)) < 0)


def test_derivatives_of_all_arguments_are_those_of_finite_differences():
    def change(x):
        return volume_change_of(*x)

    x = np.array([4e3, 1265e-9, P0, 1.3])
    gradient = np.asarray(jax.grad(change)(jnp.asarray(x)))
    for i, value in enumerate(x):
        step = np.zeros(4)
        step[i] = 1e-5 * value
        numerical = float(change(jnp.asarray(x + step)) - change(jnp.asarray(x - step))) / (2e-5 * value)
        assert gradient[i] == pytest.approx(numerical, rel=1e-7)


def test_the_impossible_is_not_a_number():
    assert np.isnan(volume_change_of(jnp.asarray(-1.1 * P0), VOLUME[0], P0))
