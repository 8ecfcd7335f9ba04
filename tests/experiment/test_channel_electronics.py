"""What parts add to a channel: noise, zeros that wander, dead zone, range and steps."""

import numpy as np
import pytest

from softfuse.experiment.channel_electronics import Readout
from softfuse.experiment.electrode_electronics import CellElectronics, LineElectronics
from softfuse.experiment.finger_electronics import Electronics
from softfuse.experiment.finger_programme import finger_channels
from softfuse.experiment.flow_electronics import FlowElectronics
from softfuse.experiment.pad_electronics import PadElectronics
from softfuse.experiment.programme import Programme
from softfuse.sensors.electronics import ChannelElectronics, equal_channels, side_by_side

TIMES = np.arange(12_000) / 100.0
LINES = LineElectronics()
PAD = PadElectronics(FlowElectronics(), LINES)


def steady(*values: float) -> Programme:
    """Channels that should always say the same."""
    names = tuple(f"c{k}" for k in range(len(values)))
    return Programme(0.01, names, np.tile(values, (5, 1)), {}, frozenset())


def said(electronics: ChannelElectronics, *values: float, seed: int = 1) -> np.ndarray:
    return Readout(steady(*values), electronics, (seed,)).read(TIMES)


def test_without_any_of_it_a_channel_says_what_it_should() -> None:
    ideal = equal_channels(2, noise=0.0, step=1e-6, low=-10.0, high=10.0)
    np.testing.assert_allclose(said(ideal, 0.123, -3.0), np.tile([0.123, -3.0], (len(TIMES), 1)), atol=1e-9)


def test_noise_is_white_and_of_its_size() -> None:
    noisy = said(equal_channels(2, noise=2e-3, step=1e-6, low=0.0, high=3.0), 0.5, 1.0)
    np.testing.assert_allclose(noisy.std(axis=0), 2e-3, rtol=0.04)
    np.testing.assert_allclose(noisy.mean(axis=0), [0.5, 1.0], atol=1e-4)
    apart = noisy - noisy.mean(axis=0)
    for lag in (1, 2, 50):
        assert np.abs((apart[lag:] * apart[:-lag]).mean(axis=0)).max() < 0.05 * 4e-6
    assert abs((apart[:, 0] * apart[:, 1]).mean()) < 0.05 * 4e-6


@pytest.mark.parametrize("times", [TIMES, np.arange(0.0, 6000.0, 0.7)])
def test_a_wander_is_stationary_and_forgets_in_its_time(times: np.ndarray) -> None:
    parts = equal_channels(40, noise=0.0, step=1e-9, low=-1.0, high=1.0, wander_sigma=4e-4, wander_time=3.0)
    drift = Readout(steady(*[0.0] * 40), parts, (2,)).read(times)
    assert drift[0].std() == pytest.approx(4e-4, rel=0.35)
    assert drift.std() == pytest.approx(4e-4, rel=0.05)
    lag = int(np.rint(2.1 / (times[1] - times[0])))
    correlation = (drift[lag:] * drift[:-lag]).mean() / (drift**2).mean()
    assert correlation == pytest.approx(np.exp(-2.1 / 3.0), abs=0.05)


def test_range_steps_gain_and_zero() -> None:
    step = 3.3 / 4096
    parts = equal_channels(
        3, noise=0.0, step=step, low=0.0, high=4095 * step, nothing=0.5, gain=1.1, zero=0.01
    )
    values = said(parts, 0.7, -1.0, 9.0)[0]
    np.testing.assert_allclose(values, [step * np.rint(0.73 / step), 0.0, 4095 * step], rtol=1e-12)
    codes = said(equal_channels(1, noise=2e-3, step=step, low=0.0, high=3.3), 0.5) / step
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-9)


def test_what_is_in_the_dead_zone_is_not_seen() -> None:
    parts = equal_channels(4, noise=0.0, step=1e-9, low=0.0, high=3.0, nothing=0.5, dead_zone=0.02)
    np.testing.assert_allclose(said(parts, 0.5, 0.519, 0.481, 0.53)[0], [0.5, 0.5, 0.5, 0.53], atol=1e-8)


def test_the_same_seed_says_the_same_however_it_is_read() -> None:
    parts = PAD.channels(2, 3, seed=4)
    programme = steady(0.5, 0.5, 2e4, 2e4, 2e4)
    whole = Readout(programme, parts, (7, 1)).read(TIMES[:500])
    readout = Readout(programme, parts, (7, 1))
    pieces = np.concatenate([readout.read(piece) for piece in np.split(TIMES[:500], [1, 2, 9, 300])])
    np.testing.assert_array_equal(whole, pieces)
    assert not np.array_equal(whole, Readout(programme, parts, (7, 2)).read(TIMES[:500]))


def test_parts_differ_by_seed_and_stay_in_their_bounds() -> None:
    one, same, other = (PAD.channels(4, 16, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.zero, same.zero)
    assert np.abs(one.zero - other.zero).min() > 0
    assert np.abs(one.zero[:4]).max() <= PAD.flow.zero_bound_V
    assert np.abs(one.zero[4:]).max() <= LINES.parasitic_bound_counts


def test_the_pads_sensors_are_those_of_their_data_sheets() -> None:
    # 0.1 L/min reads 2.5 V, 1 pF reads 2000 counts.
    np.testing.assert_allclose(PAD.flow.volts(np.array([[1e-4 / 60, 0.0]])), [[2.5, 0.5]])
    np.testing.assert_allclose(PAD.electrodes.counts(np.array([[1e-12]])), 22_000)
    assert PAD.flow.volts_per_code == pytest.approx(3.3 / 4096)


def test_cells_differ_in_rest_and_gain_and_scale_with_their_rest() -> None:
    cells = CellElectronics(noise_counts=0.0, drift_counts=0.0, own_drift_counts=0.0)
    parts = cells.channels(16, np.random.default_rng(3))
    rest, gain = cells.rest_and_gain((16,), np.random.default_rng(3))
    assert np.ptp(rest) > 1000 and 0.01 < gain.std() < 0.06
    for change in (0.0, -0.1, 1.5):
        (asked,) = cells.counts(np.full((1, 16), change))
        np.testing.assert_allclose(said(parts, *asked)[0], np.rint(rest * (1 + gain * change)), atol=1)


def test_cells_drift_as_fast_as_a_beds_do() -> None:
    """Whose random walks gain hypot(5, 2) counts in a second."""
    cells = CellElectronics(noise_counts=0.0)
    drifted = said(cells.channels(300, np.random.default_rng(1)), *[16000.0] * 300)
    for seconds in (1, 4):
        gained = drifted[100 * seconds :: 100] - drifted[: -100 * seconds : 100]
        assert gained.std() == pytest.approx(np.hypot(5.0, 2.0) * np.sqrt(seconds), rel=0.03)


def test_channels_can_be_taken_and_put_side_by_side() -> None:
    parts = finger_channels(Electronics(), 6, 12, seed=3)
    again = side_by_side([parts.taken(range(6)), parts.taken(range(6, 19))])
    np.testing.assert_array_equal(again.zero, parts.zero)
    np.testing.assert_array_equal(parts.taken([18, 0]).step, [1e-3, 5 / 4096])
