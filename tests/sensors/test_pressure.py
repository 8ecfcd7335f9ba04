"""Volts to gauge pressure: conversion, tare, range."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import nxp, raw_of

from softfuse.sensors.pressure.settings import TareSettings

DT = 0.01
STEP_V = 5.0 / 4096
FIVE = jnp.asarray(5.0)


FRAMES = 900


@eqx.filter_jit
def run(sensor, volts, resting, supply):
    dt = jnp.full(volts.shape[0], DT).at[0].set(0.0)

    def step(state, frame):
        return sensor.filtered(state, *frame)

    return jax.lax.scan(step, sensor.init(), (dt, volts, supply, resting))[1]


def read(sensor, volts, resting, supply=np.nan):
    """Readings; recordings up to FRAMES long are filled up, so that one compilation runs them all."""
    n = len(volts)
    fill = max(FRAMES - n, 0)
    resting = np.append(np.broadcast_to(np.asarray(resting, bool), n), np.zeros(fill, bool))
    supply = np.append(np.broadcast_to(np.asarray(supply, float), n), np.full(fill, np.nan))
    volts = np.concatenate([volts, np.full((fill, volts.shape[1]), np.nan)])
    return jax.tree.map(lambda x: np.asarray(x)[:n], run(sensor, volts, resting, supply))


def volts_at(sensor, gauge_Pa, *, offset_Pa=0.0, noise_V=0.0, supply=5.0, seed=0):
    """Converter readings at gauge pressures (n, k) of parts that are off by offset_Pa."""
    true = sensor.rest_Pa + np.asarray(gauge_Pa) + offset_Pa
    volts = np.asarray(sensor.gain_1_Pa * true + sensor.offset) * np.reshape(supply, (-1, 1))
    volts = volts + noise_V * np.random.default_rng(seed).standard_normal(volts.shape)
    return STEP_V * np.clip(np.round(volts / STEP_V), 0, 4095)


def press(n, begin, end, pressure_Pa, channels):
    gauge = np.zeros((n, channels))
    gauge[begin:end] = pressure_Pa
    return gauge


def test_the_ends_of_the_range_are_those_of_the_data_sheet():
    a, d = nxp("MPX5100A", 2), nxp("MPX5100D", 2)
    np.testing.assert_allclose(raw_of(a, jnp.asarray([15e3, 115e3]), FIVE), [0.2, 4.7], rtol=1e-12)
    np.testing.assert_allclose(raw_of(d, jnp.asarray([0.0, 100e3]), FIVE), [0.2, 4.7], rtol=1e-12)
    np.testing.assert_allclose(d.pressure_of(jnp.asarray([0.245, 2.45]), FIVE), [1e3, 50e3], rtol=1e-12)
    np.testing.assert_allclose(
        nxp("MPX5100G", 1).pressure_of(jnp.asarray([2.352]), jnp.asarray(4.8)), [50e3], rtol=1e-12
    )
    back = a.pressure_of(raw_of(a, jnp.asarray([20e3, 99e3]), jnp.asarray(5.1)), jnp.asarray(5.1))
    np.testing.assert_allclose(back, [20e3, 99e3], rtol=1e-12)


@pytest.mark.parametrize("part", ["MPX5100A", "MPX5100G"])
def test_a_press_is_read_over_the_tare_whatever_the_part_is_off_by(part):
    sensor = nxp(part, 2)
    gauge = press(600, 300, 500, [5e3, 1e3], 2)
    volts = volts_at(sensor, gauge, offset_Pa=np.array([2.3e3, -2.3e3]), noise_V=2e-3)
    reading = read(sensor, volts, (np.arange(600) < 295) | (np.arange(600) > 505))
    # 200 readings of 44 Pa noise and a zero from 200 to 300: the means are within 5 of 5 Pa.
    mean = np.mean(np.asarray(reading.gauge_Pa[300:500]), axis=0)
    np.testing.assert_allclose(mean, [5e3, 1e3], atol=25.0)
    assert np.all(np.asarray(reading.valid[120:]))
    assert not np.any(np.asarray(reading.out_of_range)) and not np.any(np.asarray(reading.missing))
    assert not np.any(np.asarray(reading.leaking))


def test_before_the_tare_the_reading_is_that_of_a_nominal_part_and_not_valid():
    sensor = nxp("MPX5100G", 2)
    reading = read(sensor, volts_at(sensor, np.zeros((300, 2)), offset_Pa=2e3), True)
    assert float(reading.gauge_Pa[0, 0]) == pytest.approx(2e3, abs=14.0)
    assert float(reading.sigma_Pa[0, 0]) > 2.4e3
    # Lag and settling time: 0.1 s and 1 s.
    assert 109 <= np.argmax(np.asarray(reading.valid[:, 0])) <= 113
    assert float(reading.sigma_Pa[-1, 0]) < 50.0


def test_a_device_that_never_rests_is_never_tared():
    sensor = nxp("MPX5100A", 2)
    reading = read(sensor, volts_at(sensor, np.zeros((300, 2))), False)
    assert not np.any(np.asarray(reading.valid))
    assert np.all(np.asarray(reading.sigma_Pa) > 2.4e3)


def test_errors_are_what_sigma_says():
    k, n = 128, 1500
    rng = np.random.default_rng(4)
    sensor = nxp("MPX5100A", k)
    gauge = press(n, 500, 1500, rng.uniform(-8e3, 8e3, k), k)
    drift = 2.0 * rng.standard_normal(k) * np.maximum(np.arange(n)[:, None] - 495, 0) * DT
    gain = 1.0 + 0.01 * rng.standard_normal(k)
    volts = volts_at(sensor, gauge * gain + drift, offset_Pa=rng.uniform(-2.5e3, 2.5e3, k), noise_V=2e-3)
    reading = read(sensor, volts, np.arange(n) < 495)
    for frame in (300, 550, 1490):
        error = np.asarray(reading.gauge_Pa[frame]) - gauge[frame]
        assert 0.85 < np.sqrt(np.mean((error / np.asarray(reading.sigma_Pa[frame])) ** 2)) < 1.15, frame
    assert 42.0 < np.median(np.asarray(reading.sigma_Pa[300])) < 48.0


def test_a_supply_that_sags_is_divided_out_where_it_is_measured():
    sensor = nxp("MPX5100A", 2)
    supply = np.linspace(5.1, 4.8, 600)
    gauge = press(600, 300, 600, 4e3, 2)
    volts = volts_at(sensor, gauge, supply=supply)
    resting = np.arange(600) < 300
    measured = read(sensor, volts, resting, supply)
    assert abs(float(measured.gauge_Pa[-1, 0]) - 4e3) < 60.0
    assert abs(float(read(sensor, volts, resting).gauge_Pa[-1, 0]) - 4e3) > 1e3


def test_a_supply_beyond_the_ratiometric_range_gives_no_reading():
    sensor = nxp("MPX5100A", 2)
    supply = np.full(400, 5.0)
    supply[300:310], supply[320:330] = 0.0, 4.6
    reading = read(sensor, volts_at(sensor, np.zeros((400, 2)), supply=5.0), True, supply)
    bad = (supply != 5.0) & (np.arange(400) > 150)
    assert np.array_equal(np.asarray(reading.out_of_range[:, 0]), supply != 5.0)
    assert not np.any(np.asarray(reading.valid)[bad])
    np.testing.assert_allclose(reading.gauge_Pa[150:], 0.0, atol=30.0)


def test_a_stretched_cavity_is_out_of_range_for_a_gauge_part_and_read_by_an_absolute_one():
    gauge = press(900, 300, 600, -1.5e3, 2)
    resting = (np.arange(900) < 295) | (np.arange(900) > 605)
    for part, seen in (("MPX5100G", True), ("MPX5100A", False)):
        sensor = nxp(part, 2)
        volts = volts_at(sensor, gauge, offset_Pa=np.array([1e3, -0.5e3]), noise_V=2e-3)
        flag = np.asarray(read(sensor, volts, resting).out_of_range)
        assert np.all(flag[300:600] == seen)
        assert not np.any(flag[:300]) and not np.any(flag[600:])
    absolute = read(nxp("MPX5100A", 2), volts_at(nxp("MPX5100A", 2), gauge), resting)
    np.testing.assert_allclose(absolute.gauge_Pa[599], -1.5e3, atol=30.0)


def test_a_gauge_part_whose_output_ends_at_its_offset_is_not_taken_for_zero():
    sensor = nxp("MPX5100G", 2)
    gauge = press(900, 300, 600, -3e3, 2)
    ends_at = volts_at(sensor, np.maximum(gauge, -500.0), noise_V=2e-3)
    reading = read(sensor, ends_at, np.arange(900) < 295)
    assert np.all(np.asarray(reading.out_of_range[300:600]))
    assert not np.any(np.asarray(reading.valid[300:600]))


def test_noise_at_rest_is_hardly_ever_out_of_range():
    sensor = nxp("MPX5100G", 50)
    reading = read(sensor, volts_at(sensor, np.zeros((3000, 50)), offset_Pa=-1e3, noise_V=2e-3), True)
    assert np.sum(np.asarray(reading.out_of_range)) <= 1


@pytest.mark.parametrize("end_V", [0.0, 4095 * STEP_V])
def test_readings_at_the_ends_of_the_converter_and_beyond_the_range_are_flagged(end_V):
    sensor = nxp("MPX5100A", 2)
    volts = volts_at(sensor, np.zeros((400, 2)))
    volts[300:320, 0] = end_V
    volts[300:320, 1] = float(raw_of(sensor, jnp.full(2, 116e3), FIVE)[0])
    reading = read(sensor, volts, np.arange(400) < 290)
    flag = np.asarray(reading.out_of_range)
    assert flag[300:320].all() and not flag[:300].any() and not flag[320:].any()
    assert not np.any(np.asarray(reading.valid[300:320]))
    assert np.all(np.asarray(reading.valid[320:]))


def test_a_channel_at_the_end_of_the_converter_is_no_zero():
    sensor = nxp("MPX5100G", 2)
    volts = volts_at(sensor, np.zeros((900, 2)), offset_Pa=500.0)
    volts[200:850, 0] = 0.0
    reading = read(sensor, volts, True)
    assert np.all(reading.out_of_range[200:850, 0])
    assert np.all(reading.valid[850:])
    np.testing.assert_allclose(reading.gauge_Pa[850:], 0.0, atol=30.0)


def test_missing_readings_are_flagged_held_and_no_zero():
    sensor = nxp("MPX5100A", 2)
    volts = volts_at(sensor, np.zeros((500, 2)), offset_Pa=700.0)
    volts[200:260, 0] = np.nan
    volts[:, 1] = np.nan
    reading = read(sensor, volts, True)
    gauge = np.asarray(reading.gauge_Pa)
    assert np.array_equal(np.asarray(reading.missing), np.isnan(volts))
    assert not np.any(np.asarray(reading.valid) & np.isnan(volts))
    assert np.all(np.isfinite(gauge)) and np.all(np.isfinite(np.asarray(reading.sigma_Pa)))
    np.testing.assert_allclose(gauge[150:, 0], 0.0, atol=30.0)
    assert np.all(np.asarray(reading.valid[261:, 0]))
    assert not np.any(np.asarray(reading.out_of_range))


def test_a_touch_that_is_recognised_late_is_not_tared():
    sensor = nxp("MPX5100A", 2)
    gauge = press(900, 300, 600, 0.0, 2)
    gauge[300:600] = 2e3 * np.minimum(np.arange(300) / 50, 1.0)[:, None]
    volts = volts_at(sensor, gauge, noise_V=2e-3)
    in_time = read(sensor, volts, np.arange(900) < 300)
    late = read(sensor, volts, np.arange(900) < 308)
    change = np.asarray(late.gauge_Pa[310:600] - in_time.gauge_Pa[310:600])
    # Eight more frames of rest are averaged, those before the touch.
    assert np.max(np.abs(change)) < 3.0


def test_gas_that_regains_its_temperature_after_a_release_is_not_tared():
    time = DT * np.arange(700)
    gauge = np.where(time > 4.0, -1400.0 * np.exp(-(time - 4.0) / 0.17), 0.0)[:, None] * np.ones(2)
    gauge[250:400] = 5e3
    volts = volts_at(nxp("MPX5100A", 2), gauge, noise_V=1e-3)
    resting = (time < 2.45) | (time > 4.02)

    def shift(hold_off_s):
        # Without a gate only the hold-off keeps the transient out.
        sensor = nxp("MPX5100A", 2, hold_off=hold_off_s, tare=TareSettings(gate_sigma=1e3))
        reading = read(sensor, volts, resting)
        return np.mean(reading.gauge_Pa[440:500, 0] - gauge[440:500, 0])

    assert abs(shift(1.0)) < 5.0
    assert shift(0.0) > 50.0


def test_the_pressure_can_be_differentiated_with_respect_to_the_gain():
    sensor = nxp("MPX5100G", 2)
    volts = jnp.asarray(volts_at(sensor, press(300, 200, 300, 6e3, 2)))
    volts = volts.at[150].set(jnp.nan)

    def last(sensor):
        return run(sensor, volts, jnp.arange(300) < 200, jnp.full(300, jnp.nan)).gauge_Pa[-1, 0]

    gradient = eqx.filter_grad(last)(sensor)
    relative = float(gradient.gain_1_Pa[0]) * 9e-6 / float(last(sensor))
    assert relative == pytest.approx(-1.0, rel=1e-6)
