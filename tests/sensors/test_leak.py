"""The leak test: its statistics on readings of its own model, and its decisions on simulated gas."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import leak_test, nxp, raw_of

from softfuse.sensors.pressure.leak import leak_init, leak_rate, leak_update

RATE = 50.0
P0 = 101325.0
NEVER = np.inf


def presses(duration_s, press_s, rest_s, seed, *, first_s=3.0):
    """Time (n,) [s] and the begins and ends of presses [s]."""
    rng = np.random.default_rng(seed)
    edges, now = [], first_s
    while now < duration_s:
        length = rng.uniform(*press_s)
        edges.append((now, now + length))
        now += length + rng.uniform(*rest_s)
    return np.arange(int(duration_s * RATE)) / RATE, edges


def strain_of(time, edges, amplitude, seed):
    """Relative volume taken from each cavity (n, k), with 1 % of it coming back late."""
    rng = np.random.default_rng(seed)
    strain = np.zeros((time.size, amplitude.size))
    for begin, end in edges:
        rise = np.clip(np.minimum((time - begin) / 0.3, (end - time) / 0.3), 0.0, 1.0)
        late = np.where(time > end, 0.01 * np.exp(-(time - end) / 5.0), 0.0)
        strain += (rise + late)[:, None] * amplitude * rng.uniform(0.5, 1.0, amplitude.size)
    return strain


def gas(strain, warmth_K, tau_s):
    """Gauge pressure (n, k) [Pa] of gas that is adiabatic at first, as warm as the walls later, and leaks.

    Mass and temperature are relative to those at the start; tau_s (n, k) or a number.
    """
    n, k = strain.shape
    tau = np.broadcast_to(np.asarray(tau_s, float), (n, k))
    mass, heat, pressure = np.ones(k), np.ones(k), np.zeros((n, k))
    last = 1.0 - strain[0]
    for i in range(n):
        volume = 1.0 - strain[i]
        wall = 1.0 + warmth_K[i] / 295.0
        heat = wall + (heat * (last / volume) ** 0.4 - wall) * np.exp(-1.0 / (RATE * 0.17))
        pressure[i] = P0 * (mass * heat / volume - 1.0)
        mass = mass - pressure[i] / P0 / (RATE * tau[i])
        last = volume
    return pressure


def digitised(sensor, pressure, seed):
    """Volts of parts with their own offsets, 2 mV noise and a 12-bit converter."""
    rng = np.random.default_rng(seed)
    offset = rng.uniform(-1.5e3, 1.5e3, pressure.shape[1])
    volts = np.asarray(raw_of(sensor, sensor.rest_Pa + pressure + offset, jnp.asarray(5.0)))
    step = 5.0 / 4096
    return step * np.clip(np.round((volts + 2e-3 * rng.standard_normal(volts.shape)) / step), 0, 4095)


CHUNK = 1000


@eqx.filter_jit
def scan_chunk(sensor, state, volts, resting):
    def step(state, frame):
        dt, supply = jnp.asarray(1.0 / RATE), jnp.asarray(jnp.nan)
        state, reading = sensor.filtered(state, dt, frame[0], supply, frame[1])
        return state, (reading.leaking, reading.leak_rate_1_s, reading.leak_rate_sigma_1_s)

    return jax.lax.scan(step, state, (volts, resting))


def scan_frames(sensor, volts, resting):
    """Flags, rates and their standard deviations (n, k); in chunks, to compile once for all lengths."""
    n, k = volts.shape
    fill = -n % CHUNK
    volts = np.concatenate([volts, np.full((fill, k), np.nan)])
    resting = np.append(resting, np.zeros(fill, bool))
    state, parts = sensor.init(), []
    for begin in range(0, n, CHUNK):
        state, part = scan_chunk(sensor, state, volts[begin : begin + CHUNK], resting[begin : begin + CHUNK])
        parts.append(part)
    return tuple(np.concatenate(x)[:n] for x in zip(*parts, strict=True))


def judge(sensor, time, edges, pressure, seed=3):
    """Flags, rates and their standard deviations (n, k); touch is seen 30 ms late and released 20 ms late."""
    touched = np.zeros(time.size, bool)
    for begin, end in edges:
        touched |= (time > begin + 0.03) & (time < end + 0.02)
    return scan_frames(sensor, digitised(sensor, pressure, seed), ~touched)


def drifting_warmth(time):
    """Ten minutes that warm by 1 K, with swings of half a kelvin [K]."""
    return time / 600.0 + 0.5 * np.sin(2 * np.pi * time / 300.0)


AMPLITUDE = np.array([0.002, 0.005, 0.01, 0.02, 0.04, 0.08, -0.002, -0.005, -0.01, -0.02, -0.04, -0.08] * 4)


@pytest.mark.parametrize(("press_s", "rest_s"), [((1.0, 20.0), (3.0, 10.0)), ((0.3, 2.0), (1.0, 6.0))])
def test_ten_minutes_of_healthy_presses_and_drift_raise_no_alarm(press_s, rest_s):
    time, edges = presses(600.0, press_s, rest_s, seed=1)
    strain = strain_of(time, edges, AMPLITUDE, seed=2)
    pressure = gas(strain, drifting_warmth(time), NEVER)
    leaking, rate, sigma = judge(nxp("MPX5100A", AMPLITUDE.size), time, edges, pressure)
    assert len(edges) > 30
    assert not leaking.any()
    # Not even close: a false alarm would take 5.
    assert np.max((rate - 1 / 120) / sigma) < 3.0


@pytest.mark.parametrize("tau_s", [5.0, 10.0, 30.0])
def test_a_leak_that_opens_after_five_minutes_is_seen_and_its_rate_told(tau_s):
    time, edges = presses(480.0, (5.0, 15.0), (3.0, 8.0), seed=4)
    amplitude = np.array([0.03, 0.06, -0.03, -0.06, 0.05, -0.05])
    opened = time > 300.0
    tau = np.where(opened[:, None] & (np.arange(6) < 4), tau_s, NEVER)
    strain = strain_of(time, edges, amplitude, seed=5)
    leaking, rate, sigma = judge(nxp("MPX5100A", 6), time, edges, gas(strain, drifting_warmth(time), tau))
    after = [end for _, end in edges if end > 302.0]
    assert not leaking[~opened].any()
    assert not leaking[:, 4:].any()
    # One press of at least 1.5 kPa for 5 s is enough, or nearly: flagged after the first or second release.
    assert leaking[time > after[1] + 2.0, :4].all()
    assert leaking[(time > after[0] + 2.0) & (time < after[0] + 2.5), :4].mean() > 0.7
    np.testing.assert_allclose(rate[-1, :4], 1 / tau_s, rtol=0.12)
    assert np.all(np.abs(rate[-1, 4:]) < 4 * sigma[-1, 4:])


def test_a_mended_cavity_is_believed_again():
    time, edges = presses(300.0, (5.0, 10.0), (3.0, 6.0), seed=6)
    amplitude = np.array([0.04, -0.04])
    tau = np.where(time[:, None] < 100.0, 10.0, NEVER) * np.ones(2)
    strain = strain_of(time, edges, amplitude, seed=7)
    leaking, _, _ = judge(nxp("MPX5100A", 2), time, edges, gas(strain, 0.0 * time, tau))
    assert leaking[(time > 60.0) & (time < 100.0)].all()
    assert not leaking[time > 150.0].any()


def test_a_gauge_part_sees_the_leak_of_a_squeezed_cavity():
    time, edges = presses(60.0, (5.0, 10.0), (3.0, 6.0), seed=8)
    amplitude = np.array([0.02, 0.02])
    tau = np.array([20.0, NEVER])
    strain = strain_of(time, edges, amplitude, seed=9)
    leaking, _, _ = judge(nxp("MPX5100G", 2), time, edges, gas(strain, 0.0 * time, tau))
    assert leaking[-1, 0]
    assert not leaking[:, 1].any()


def test_a_hand_that_gives_way_is_no_leak_while_it_presses_or_afterwards():
    time = np.arange(int(60 * RATE)) / RATE
    held = (time > 5.0) & (time < 45.0)
    strain = np.where(held, 0.05 * np.exp(-(time - 5.0) / 10.0), 0.0)[:, None] * np.array([1.0, -1.0])
    leaking, _, _ = judge(nxp("MPX5100A", 2), time, [(5.0, 45.0)], gas(strain, 0.0 * time, NEVER))
    assert not leaking.any()


@pytest.mark.parametrize(("tau_s", "leaks"), [(150.0, [False, False]), (15.0, [True, False])])
def test_readings_that_are_lost_during_a_press_are_no_evidence(tau_s, leaks):
    time = np.arange(int(80 * RATE)) / RATE
    edges = [(3.0, 63.0)]
    strain = strain_of(time, edges, np.array([0.1, 0.1]), seed=1)
    sensor = nxp("MPX5100A", 2)
    volts = digitised(sensor, gas(strain, 0.0 * time, tau_s), 2)
    volts[(time > 4.0) & (time < 60.0), 1] = np.nan
    leaking, rate, sigma = scan_frames(sensor, volts, (time < 3.03) | (time > 63.02))
    assert np.array_equal(leaking[-1], leaks)
    assert np.all(np.isfinite(rate)) and np.all(np.isfinite(sigma))


@eqx.filter_jit
def scan_test(test, pressure, at_rest, dt, noise):
    k = pressure.shape[1]

    def step(state, frame):
        yes = jnp.ones(k, bool)
        state = leak_update(test, state, dt, frame[0], jnp.full(k, noise), yes, yes, frame[1])
        return state, None

    return jax.lax.scan(step, leak_init(k), (pressure, at_rest))[0]


def test_the_rate_is_unbiased_and_its_error_what_sigma_says():
    """Six presses of cavities that leak with 1/40 s; the rest shape comes back as badly as assumed."""
    rng = np.random.default_rng(0)
    k, dt, noise, theta = 600, 0.02, 44.0, 1 / 40
    pressed = np.tile(np.arange(400) >= 150, 6)
    at_rest = np.concatenate([~pressed, np.ones(150, bool)])
    pressure, level, squeeze = np.empty((at_rest.size, k)), np.zeros(k), np.zeros(k)
    for i, rests in enumerate(at_rest):
        begins, ends = i > 0 and at_rest[i - 1] and not rests, i > 0 and rests and not at_rest[i - 1]
        if begins:
            squeeze = rng.uniform(200.0, 4000.0, k)
        if ends:
            # 5.5 s between the means: the press and the window.
            squeeze = np.zeros(k)
            level = level + np.hypot(20.0, 5.0 * 5.5) * rng.standard_normal(k)
        pressure[i] = level + squeeze
        level = level - theta * pressure[i] * dt
    pressure += noise * rng.standard_normal(pressure.shape)
    test = leak_test(memory=1e9)
    rate, sigma = leak_rate(test, scan_test(test, pressure, at_rest, jnp.asarray(dt), noise))
    normalised = (np.asarray(rate) - theta) / np.asarray(sigma)
    assert abs(np.mean(normalised)) < 0.15
    assert 0.92 < np.std(normalised) < 1.08


def test_a_single_press_has_the_rate_of_the_closed_form():
    dt, theta = 0.02, 1 / 15
    time = np.arange(1000) * dt
    at_rest = (time < 4.0) | (time >= 12.0)
    # 3 kPa that decays while held, and the deficit afterwards, which decays as well.
    held = 3000.0 * np.exp(-theta * (time - 4.0))
    after = -3000.0 * (1 - np.exp(-theta * 8.0)) * np.exp(-theta * (time - 12.0))
    pressure = np.where(time < 4.0, 0.0, np.where(time < 12.0, held, after))[:, None]
    test = leak_test(fastest=1e-3)
    rate, sigma = leak_rate(test, scan_test(test, pressure, at_rest, jnp.asarray(dt), 44.0))
    assert float(rate[0]) == pytest.approx(theta, rel=0.01)
    area = np.sum(held[(time >= 4.0) & (time < 12.0)]) * dt
    # Two means of window length, the earlier one with exponential weights, 20 Pa and 5 Pa/s over 8.5 s.
    spread = np.sqrt(44.0**2 * (1 / 25 + 0.5 * dt / 0.5) + 20.0**2 + (5.0 * 8.5) ** 2)
    assert float(sigma[0]) == pytest.approx(spread / area, rel=0.03)
