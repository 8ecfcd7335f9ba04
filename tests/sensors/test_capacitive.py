"""Baseline, broken electrodes, image."""

import jax
import jax.numpy as jnp
import numpy as np
from made_sensors import capacitive_array

from softfuse.sensors.capacitive import array_init, array_signal, track_baseline

ARRAY = capacitive_array()


@jax.jit
def run(counts, near, touching):
    def step(state, frame):
        value, is_near, is_touching = frame
        reading = array_signal(ARRAY, state, value)
        return track_baseline(ARRAY, state, jnp.asarray(0.01), value, is_near, is_touching), reading

    return jax.lax.scan(step, array_init(counts.shape[1]), (counts, near, touching))


def noise(n, level=20000.0, e=16, seed=0):
    return level + np.round(8.0 * np.random.default_rng(seed).standard_normal((n, e)))


def test_baseline_follows_drift_and_averages_noise():
    counts = noise(3000) + np.linspace(0.0, 60.0, 3000)[:, None]
    idle = np.zeros(3000, bool)
    state, reading = run(counts, idle, idle)
    np.testing.assert_allclose(state.baseline_counts, 20060.0, atol=6.0)
    assert np.std(np.asarray(reading.signal_counts[500:])) < 8.6
    assert np.all(np.asarray(reading.valid[1:]))


def test_baseline_is_frozen_by_touch_and_creeps_by_proximity():
    counts = noise(2300)
    counts[300:] += 1000.0
    late = np.arange(2300) >= 300
    frozen, _ = run(counts, late, late)
    creeping, _ = run(counts, late, np.zeros(2300, bool))
    np.testing.assert_allclose(frozen.baseline_counts, 20000.0, atol=3.0)
    expected = 20000.0 + 1000.0 * (1.0 - np.exp(-20.0 / 60.0))
    np.testing.assert_allclose(creeping.baseline_counts, expected, atol=8.0)


def test_a_baseline_taken_under_a_finger_recovers_when_it_leaves():
    counts = noise(500)
    counts[:200] += 3000.0
    idle = np.zeros(500, bool)
    _, reading = run(counts, idle, idle)
    assert np.all(np.abs(np.asarray(reading.signal_counts[-1])) < 60.0)


def test_missing_stuck_and_out_of_range_channels_are_invalid_and_come_back():
    counts = noise(400)
    counts[100:200, 3] = np.nan
    counts[100:200, 5] = 20000.0
    counts[100:200, 7] = 0.0
    counts[100:200, 9] = 65535.0
    idle = np.zeros(400, bool)
    _, reading = run(counts, idle, idle)
    valid = np.asarray(reading.valid)
    for channel in (3, 7, 9):
        assert not valid[100:200, channel].any()
    assert not valid[130:200, 5].any()
    others = np.delete(np.arange(16), [3, 5, 7, 9])
    assert valid[1:, others].all() and valid[205:].all()
    assert np.all(np.isfinite(np.asarray(reading.signal_counts)))
    assert np.all(np.abs(np.asarray(reading.signal_counts[205:])) < 60.0)


def test_an_electrode_that_appears_during_a_touch_takes_no_baseline_from_it():
    counts = noise(300)
    counts[:150, 4] = np.nan
    touching = (np.arange(300) > 100) & (np.arange(300) < 200)
    counts[touching] += 3000.0
    _, reading = run(counts, touching, touching)
    valid = np.asarray(reading.valid)
    assert not valid[:200, 4].any() and valid[210:, 4].all()
