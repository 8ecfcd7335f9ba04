"""Contact detection on single-ended electrodes, broken ones included."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import single_electrodes

ELECTRODES = single_electrodes(12)
DT = 0.01


CHUNK = 500


@eqx.filter_jit
def scan_chunk(electrodes, state, counts, dt):
    def step(state, row):
        return electrodes.filtered(state, dt, row)

    return jax.lax.scan(step, state, counts)


def run(counts, electrodes=ELECTRODES, dt=DT):
    """Final state and readings; in chunks, so that all recordings are run by one compilation."""
    state, readings = electrodes.init(), []
    n = len(counts)
    padded = np.full((-(-n // CHUNK) * CHUNK, 12), np.nan)
    padded[:n] = counts
    for chunk in np.split(padded, len(padded) // CHUNK):
        state, reading = scan_chunk(electrodes, state, jnp.asarray(chunk), jnp.asarray(dt))
        readings.append(reading)
    return state, jax.tree.map(lambda *parts: np.concatenate(parts)[:n], *readings)


def idle(n, seed=0, noise=8.0):
    rng = np.random.default_rng(seed)
    level = rng.uniform(15000, 25000, 12)
    return np.round(level + noise * rng.standard_normal((n, 12)))


def test_noise_and_drift_alone_touch_nothing_and_lose_nothing():
    counts = idle(20000) + np.linspace(0.0, 1500.0, 20000)[:, None]
    state, reading = run(counts)
    assert not reading.touched.any() and not reading.lost.any() and not reading.near.any()
    # The drift of 7.5 counts/s is followed with a lag of the baseline's 2 s.
    np.testing.assert_allclose(reading.signal_counts[-500:].mean(axis=0), 15.0, atol=3.0)
    np.testing.assert_allclose(state.square_counts2, 2 * 64.0, rtol=0.5)


def test_a_touch_begins_after_the_debouncing_frames_and_ends_so():
    counts = idle(600)
    counts[200:400, 4] += 2000.0
    _, reading = run(counts)
    expected = np.zeros((600, 12), bool)
    expected[202:402, 4] = True
    assert np.array_equal(reading.touched, expected)
    np.testing.assert_allclose(reading.signal_counts[202:400, 4].mean(), 2000.0, atol=5.0)


def test_between_the_thresholds_the_state_stays_what_it_was():
    counts = idle(1500)
    counts[300:600, 0] += 500.0
    counts[600:700, 0] += 900.0
    counts[700:1000, 0] += 500.0
    _, reading = run(counts)
    assert not reading.touched[:600, 0].any()
    assert reading.touched[602:1000, 0].all()
    assert not reading.touched[1003:, 0].any()
    assert reading.near[300:1000, 0].all()


def test_spikes_and_holes_neither_begin_nor_end_a_touch():
    counts = idle(600)
    counts[100:102, 1] += 5000.0
    counts[200:500, 2] += 2000.0
    counts[300:302, 2] -= 2000.0
    counts[350:356, 2] = np.nan
    counts[400:405, 2] = 65535.0
    _, reading = run(counts)
    assert not reading.touched[:, 1].any()
    assert reading.touched[202:500, 2].all()
    assert not reading.lost.any()
    assert np.array_equal(reading.missing, np.isnan(counts))


def test_the_baseline_is_frozen_by_its_own_touch_only():
    counts = idle(3000) + np.linspace(0.0, 300.0, 3000)[:, None]
    counts[500:2500, 6] += 3000.0
    state, reading = run(counts)
    start = counts[480:500, 6].mean()
    signal = counts[2400:2500, 6].mean() - start
    assert reading.signal_counts[2400:2500, 6].mean() == pytest.approx(signal, abs=25.0)
    np.testing.assert_allclose(
        np.delete(state.array.baseline_counts, 6), np.delete(counts[-200:].mean(axis=0), 6), atol=25.0
    )
    assert reading.touched[502:2500, 6].all()


@pytest.mark.parametrize("kind", ["equal", "toggling"])
@pytest.mark.parametrize("above", [0.0, 4000.0])
def test_an_electrode_whose_noise_vanishes_is_stuck_touched_or_not(kind, above):
    counts = idle(2400)
    dead = np.round(counts[300, 3]) + above
    counts[400:1600, 3] = dead + (np.arange(1200) % 7 == 0 if kind == "toggling" else 0.0)
    _, reading = run(counts)
    seen = 400 + np.argmax(reading.stuck[400:, 3])
    # 25 equal readings, or the noise measured over 1 s down to 1 % of its square.
    assert 424 <= seen <= 430 if kind == "equal" else 500 < seen < 1300
    assert reading.lost[seen:1600, 3].all() and not reading.touched[seen:1600, 3].any()
    assert not np.delete(reading.lost, 3, axis=1).any()
    assert not reading.lost[1610:, 3].any() and not reading.touched[1800:, 3].any()


@pytest.mark.parametrize("end", [0.0, 65535.0])
def test_an_electrode_at_the_end_of_the_converter_is_stuck(end):
    counts = idle(500)
    counts[200:400, 8] = end
    _, reading = run(counts)
    assert not reading.stuck[:210, 8].any()
    assert reading.stuck[213:400, 8].all() and reading.lost[213:400, 8].all()
    assert not reading.lost[401:, 8].any() and not reading.touched[:, 8].any()


def test_a_missing_electrode_is_lost_but_not_stuck_and_comes_back_untouched():
    counts = idle(600)
    counts[100:, 5] += 2000.0
    counts[200:400, 5] = np.nan
    counts[400:, 5] -= 2000.0
    counts[:, 9] = np.nan
    _, reading = run(counts)
    assert reading.lost[215:400, 5].all() and not reading.stuck[:, 5].any()
    assert not reading.touched[215:, 5].any() and not reading.lost[401:, 5].any()
    assert not reading.lost[:10].any()
    assert reading.lost[15:, 9].all() and not reading.touched[:, 9].any()
    assert np.all(np.isfinite(reading.signal_counts))


def test_a_touch_without_end_is_stuck_and_calibrated_away():
    electrodes = single_electrodes(12, longest_touch=20.0, creep_time=10.0)
    counts = idle(8000)
    counts[500:, 7] += 2000.0
    counts[500:1500, 2] += 2000.0
    _, reading = run(counts, electrodes)
    assert reading.touched[502:2501, 7].all()
    assert reading.stuck[2503:3500, 7].all() and not reading.touched[2503:, 7].any()
    # From 2000 to 400 counts in 10 s ln 5 = 16 s of creeping.
    believed = 2503 + np.argmin(reading.lost[2503:, 7])
    assert believed == pytest.approx(2503 + 1609, abs=30)
    assert not reading.lost[believed:, 7].any()
    assert not reading.lost[:, 2].any() and reading.touched[502:1500, 2].all()


def test_what_was_calibrated_away_does_not_hide_the_next_touch():
    electrodes = single_electrodes(12, longest_touch=5.0, creep_time=2.0)
    counts = idle(4000)
    counts[200:2500, 0] += 2000.0
    counts[2700:3500, 0] += 1500.0
    _, reading = run(counts, electrodes)
    assert reading.touched[2703:3100, 0].all()
    assert not reading.touched[2503:2700, 0].any() and not reading.touched[3505:, 0].any()


def test_electrodes_have_thresholds_of_their_own():
    electrodes = eqx.tree_at(lambda d: d.on_counts, ELECTRODES, ELECTRODES.on_counts.at[3].set(3000.0))
    counts = idle(400)
    counts[200:] += 2000.0
    _, reading = run(counts, electrodes)
    assert np.array_equal(reading.touched[-1], np.arange(12) != 3)


def test_touched_electrodes_hold_their_slots_and_lost_ones_give_them_up():
    counts = idle(1000)
    counts[200:900, 4] += 1000.0
    counts[300:900, 10] += 5000.0
    counts[400:900, 1] += 3000.0
    counts[450:900, 6] += 9000.0
    counts[600:, 10] = 65535.0
    _, reading = run(counts)
    slots = np.where(reading.slots.used, reading.slots.electrode, -1)
    assert slots[250].tolist() == [4, -1, -1]
    assert slots[350].tolist() == [4, 10, -1]
    assert slots[550].tolist() == [4, 10, 1]
    assert slots[650].tolist() == [4, 6, 1]
    assert slots[950].tolist() == [-1, -1, -1]


def test_a_slow_rate_with_uneven_frames_and_a_first_frame_without_readings_work():
    counts = idle(200)
    counts[0] = np.nan
    counts[100:150, 2] += 2000.0
    _, reading = run(counts, dt=0.05)
    assert reading.touched[102:150, 2].all() and not reading.lost[5:].any()
