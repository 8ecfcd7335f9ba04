"""What parts add to a channel: noise, zeros that wander, range and steps."""

import numpy as np
import pytest

from softfuse.sensors.electronics import ChannelElectronics, Converter, equal_channels, side_by_side

TIMES = np.arange(12_000) / 100.0


def said(
    electronics: ChannelElectronics, *values: float, times: np.ndarray = TIMES, seed: int = 1
) -> np.ndarray:
    """What channels say that should always say the same."""
    return Converter(electronics, np.random.default_rng(seed)).read(times, np.tile(values, (len(times), 1)))


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
    drift = said(parts, *[0.0] * 40, times=times, seed=2)
    assert drift[0].std() == pytest.approx(4e-4, rel=0.35)
    assert drift.std() == pytest.approx(4e-4, rel=0.05)
    lag = int(np.rint(2.1 / (times[1] - times[0])))
    correlation = (drift[lag:] * drift[:-lag]).mean() / (drift**2).mean()
    assert correlation == pytest.approx(np.exp(-2.1 / 3.0), abs=0.05)


@pytest.mark.parametrize("times", [TIMES, np.arange(0.0, 1200.0, 0.7)])
def test_a_drift_keeps_its_rate_for_its_time(times: np.ndarray) -> None:
    rate, memory, count = 2e-3, 20.0, 400
    parts = equal_channels(count, noise=0.0, drift=rate, drift_time=memory)
    drift = said(parts, *[0.0] * count, times=times, seed=3)
    step = times[1] - times[0]
    for seconds in (2 * step, 2.1, 20.0, 60.0):
        lag = int(np.rint(seconds / step))
        a = lag * step / memory
        # The variance of a difference, from the process's covariance.
        expected = rate * memory * np.sqrt(2.0 * (1.0 - (1.0 + a) * np.exp(-a)))
        moved = drift[lag:] - drift[:-lag]
        assert np.sqrt((moved**2).mean()) == pytest.approx(expected, rel=0.06)
    assert drift[0].std() == pytest.approx(rate * memory, rel=0.1)


def test_range_steps_gain_and_zero() -> None:
    step = 3.3 / 4096
    parts = equal_channels(
        3, noise=0.0, step=step, low=0.0, high=4095 * step, nothing=0.5, gain=1.1, zero=0.01
    )
    values = said(parts, 0.7, -1.0, 9.0)[0]
    np.testing.assert_allclose(values, [step * np.rint(0.73 / step), 0.0, 4095 * step], rtol=1e-12)
    codes = said(equal_channels(1, noise=2e-3, step=step, low=0.0, high=3.3), 0.5) / step
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-9)


def test_the_same_seed_says_the_same_however_it_is_read() -> None:
    parts = equal_channels(
        2, noise=1e-3, step=1e-6, low=-9.0, high=9.0, wander_sigma=1e-3, slow_sigma=1e-3, drift=1e-3
    )
    asked = np.tile([0.5, 1.0], (500, 1))
    whole, pieces, other = (Converter(parts, np.random.default_rng(seed)) for seed in (7, 7, 8))
    read = whole.read(TIMES[:500], asked)
    cut = zip(np.split(TIMES[:500], [1, 2, 9, 300]), np.split(asked, [1, 2, 9, 300]), strict=True)
    np.testing.assert_array_equal(read, np.concatenate([pieces.read(*piece) for piece in cut]))
    assert not np.array_equal(read, other.read(TIMES[:500], asked))


def test_what_has_no_step_is_not_rounded() -> None:
    assert said(equal_channels(1, noise=0.0), 0.1234567890123)[0, 0] == 0.1234567890123


def test_channels_can_be_taken_and_put_side_by_side() -> None:
    parts = side_by_side(
        [equal_channels(2, noise=1.0, zero=np.array([1.0, 2.0])), equal_channels(1, noise=2.0)]
    )
    assert parts.zero.tolist() == [1.0, 2.0, 0.0] and parts.taken([2, 0]).noise.tolist() == [2.0, 1.0]
