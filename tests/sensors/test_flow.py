"""Volts to volume: integration, the zero, lost flow."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import d6f_p0001a1

SENSOR = d6f_p0001a1(4)
SENSITIVITY = 1.2e6  # V s/m^3, 20 V per L/min
MM3 = 1e-9


@eqx.filter_jit
def run(sensor, dt, volts, touching):
    def step(state, frame):
        return sensor.filtered(state, *frame)

    return jax.lax.scan(step, sensor.init(), (dt, volts, touching))[1]


def frames(n, dt=0.01):
    step = np.full(n, dt)
    step[0] = 0.0
    return step


def press(n, flow_m3_s, begin, end, zero=0.503):
    """Readings with a constant flow out of channel 0 between two frames, no noise."""
    volts = np.full((n, 4), zero)
    volts[begin:end, 0] += flow_m3_s * SENSITIVITY
    return volts


def test_constant_flow_integrates_to_its_volume_and_outflow_is_negative():
    volts = press(500, 200 * MM3, 300, 400)
    touching = np.arange(500) >= 295
    reading = run(SENSOR, frames(500), volts, touching)
    np.testing.assert_allclose(reading.volume_change_m3[450], [-200 * MM3, 0, 0, 0], atol=0.3 * MM3)
    np.testing.assert_allclose(reading.flow_m3_s[350], [200 * MM3, 0, 0, 0], atol=1 * MM3)
    assert np.all(np.asarray(reading.volume_valid[450]))


def test_a_touch_recognised_late_loses_no_flow():
    volts = press(500, 200 * MM3, 300, 400)
    in_time = run(SENSOR, frames(500), volts, np.arange(500) >= 298)
    late = run(SENSOR, frames(500), volts, np.arange(500) >= 315)
    error = late.volume_change_m3[450] - in_time.volume_change_m3[450]
    np.testing.assert_allclose(error, 0.0, atol=0.1 * MM3)


def test_uneven_steps_are_integrated_by_the_trapezoidal_rule():
    rng = np.random.default_rng(0)
    dt = rng.uniform(0.004, 0.02, 700)
    dt[0] = 0.0
    time = np.cumsum(dt)
    begin = time[350]
    flow = np.where(time > begin, 300 * MM3 * np.sin(2.0 * (time - begin)), 0.0)
    volts = np.full((700, 4), 0.5) + flow[:, None] * SENSITIVITY
    reading = run(SENSOR, dt, volts, time >= begin)
    exact = -300 * MM3 * (1.0 - np.cos(2.0 * (time - begin))) / 2.0
    np.testing.assert_allclose(reading.volume_change_m3[360:, 1], exact[360:], atol=0.05 * MM3)


def test_a_few_missing_readings_are_bridged_and_flagged_while_missing():
    time = 0.01 * np.arange(600)
    flow = np.where(time > 3.0, 200 * MM3 * (time - 3.0), 0.0)
    volts = np.full((600, 4), 0.5) + flow[:, None] * SENSITIVITY
    touching = time > 2.99
    whole = run(SENSOR, frames(600), volts, touching)
    volts[400:404, 2] = np.nan
    holed = run(SENSOR, frames(600), volts, touching)
    assert np.array_equal(np.asarray(holed.missing[399:405, 2]), [False, True, True, True, True, False])
    assert not np.any(np.asarray(holed.volume_valid[400:404, 2]))
    assert np.all(np.asarray(holed.volume_valid[404:, 2]))
    np.testing.assert_allclose(holed.volume_change_m3[599], whole.volume_change_m3[599], atol=0.02 * MM3)
    assert np.all(np.isfinite(np.asarray(holed.volume_change_m3)))


@pytest.mark.parametrize("cause", ["missing", "gap"])
def test_a_long_hole_makes_the_volume_invalid_until_the_reset(cause):
    volts, dt = press(1000, 100 * MM3, 300, 500), frames(1000)
    if cause == "missing":
        volts[350:380, 0] = np.nan
    else:
        dt[360] = 0.5
    touching = (np.arange(1000) > 295) & (np.arange(1000) < 600)
    reading = run(SENSOR, dt, volts, touching)
    assert not np.any(np.asarray(reading.volume_valid[400:600, 0]))
    assert float(reading.volume_sigma_m3[500, 0]) > 50 * MM3
    assert np.all(np.asarray(reading.volume_valid[700:, 0]))
    assert np.all(np.asarray(reading.volume_valid[400:600, 1])) == (cause == "missing")


@pytest.mark.parametrize("clipped", [0.0, 3.3])
def test_a_clipped_channel_is_flagged_until_the_integral_is_reset(clipped):
    volts = press(1000, 100 * MM3, 300, 500)
    volts[400:402, 0] = clipped
    touching = (np.arange(1000) > 295) & (np.arange(1000) < 600)
    reading = run(SENSOR, frames(1000), volts, touching)
    assert not np.any(np.asarray(reading.saturated[:400]))
    assert np.all(np.asarray(reading.saturated[400:640, 0]))
    assert not np.any(np.asarray(reading.volume_valid[400:640, 0]))
    assert not np.any(np.asarray(reading.saturated[:, 1:]))
    assert not np.any(np.asarray(reading.saturated[700:]))
    assert np.all(np.asarray(reading.volume_valid[700:]))


def test_air_that_flows_back_is_not_taken_for_the_zero():
    n = 1500
    time = 0.01 * np.arange(n)
    volts = press(n, 150 * MM3, 300, 400)
    tail = np.where(time > 6.0, -500 * MM3 * np.exp(-(time - 6.0) / 0.3), 0.0)
    volts[:, 0] += tail * SENSITIVITY
    reading = run(SENSOR, frames(n), volts, (time > 2.95) & (time < 6.0))
    zero = np.asarray(reading.zero_V[:, 0])
    assert np.max(np.abs(zero[600:] - 0.503)) < 0.4e-3
    # The gas that has come back closes the balance before the reset.
    assert abs(float(reading.volume_change_m3[800, 0])) < 3 * MM3
    assert abs(float(reading.volume_change_m3[-1, 0])) < 0.5 * MM3


def test_a_jump_of_the_zero_is_learnt_after_a_while():
    volts = np.full((1500, 4), 0.5)
    volts[400:] += 9e-3
    reading = run(SENSOR, frames(1500), volts, np.zeros(1500, bool))
    assert abs(float(reading.zero_V[450, 0]) - 0.5) < 0.5e-3
    assert abs(float(reading.zero_V[-1, 0]) - 0.509) < 0.3e-3


def test_errors_of_noisy_wandering_readings_are_what_sigma_says_and_small():
    rng = np.random.default_rng(3)
    k, n = 64, 1200
    sensor = d6f_p0001a1(k)
    wander = np.zeros((n, k))
    decay = np.exp(-0.01 / 3.0)
    wander[0] = 0.4e-3 * rng.standard_normal(k)
    for i in range(1, n):
        wander[i] = decay * wander[i - 1] + 0.4e-3 * np.sqrt(1 - decay**2) * rng.standard_normal(k)
    bias = 0.5 + 4e-3 * rng.standard_normal(k)
    touching = (np.arange(n) > 600) & (np.arange(n) < 1100)
    volts = bias + wander + 2e-3 * rng.standard_normal((n, k))
    volts[605:705] += 100 * MM3 * SENSITIVITY
    step = 3.3 / 4096
    reading = run(sensor, frames(n), np.round(volts / step) * step, touching)
    for frame, bound in ((720, 0.45), (1090, 1.5)):
        error = np.asarray(reading.volume_change_m3[frame]) + 100 * MM3
        sigma = np.asarray(reading.volume_sigma_m3[frame])
        assert np.mean(np.abs(error)) < bound * MM3
        assert 0.8 < np.sqrt(np.mean((error / sigma) ** 2)) < 1.25


def test_a_single_channel_and_a_frame_without_any_reading_work():
    sensor = d6f_p0001a1(1)
    reading = run(sensor, frames(50), np.full((50, 1), np.nan), np.zeros(50, bool))
    assert not np.any(np.asarray(reading.volume_valid))
    assert np.all(np.isfinite(np.asarray(reading.volume_change_m3)))


def test_the_volume_can_be_differentiated_with_respect_to_the_sensitivity():
    volts = jnp.asarray(press(400, 200 * MM3, 300, 380))
    touching = jnp.arange(400) >= 295

    def volume(sensor):
        return run(sensor, jnp.asarray(frames(400)), volts, touching).volume_change_m3[-1, 0]

    gradient = eqx.filter_grad(volume)(SENSOR)
    relative = float(gradient.sensitivity_Vs_m3[0]) * SENSITIVITY / float(volume(SENSOR))
    assert relative == pytest.approx(-1.0, rel=1e-9)
