"""Gains of crossed electrodes, fitted to presses of known place on a made-up array."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import peak_model, peak_signal

from softfuse.calibration.array_pose import pose_slopes
from softfuse.calibration.electrode_gains import GainFit, LineSignals, fit_gains
from softfuse.sensors.crossed.settings import PoseSettings

LINES = 1e-3 * (-28.0 + 8.0 * np.arange(8))
MODEL = peak_model(LINES, LINES, 1.5e-3, 1.0e-3)
NAMES = tuple(f"{what}{k} gain" for what in ("row", "col") for k in range(8))
POSE_SIGMA = np.array([0.5e-3, 0.5e-3, 0.02, 0.01, 0.01])
DRAWN = PoseSettings().pose()
GAIN = 0.05
SIGNALS = jax.jit(jax.vmap(lambda *unknowns: peak_signal(MODEL, *unknowns)))


def pressed(rng: np.random.Generator, presses: int, gain: np.ndarray, pose: np.ndarray) -> LineSignals:
    """Three samples a press, by lines of ln gains (16,) on an array with a pose (5,), which the model misses
    as much as it says.
    """
    place = np.repeat(rng.uniform(-0.028, 0.028, (presses, 2)), 3, axis=0)
    count = len(place)
    radius = rng.normal(MODEL.radius_m, MODEL.radius_sigma_m, count)
    signal = SIGNALS(
        jnp.asarray(place - pose_slopes(place) @ pose),
        jnp.asarray(rng.uniform(4000.0, 6000.0, (count, 2))),
        jnp.asarray(rng.normal(0.0, MODEL.offset_sigma_counts, (count, 2))),
        jnp.asarray(radius),
        jnp.asarray(rng.normal(0.0, 0.2e-3, count)),
    )
    signal = np.asarray(signal) * np.exp(gain)
    alike = np.repeat(rng.normal(size=(presses, 16)), 3, axis=0)
    own = rng.normal(size=signal.shape)
    missed = float(MODEL.model_error) * signal.max(axis=1, keepdims=True)
    signal = signal + missed * (np.sqrt(0.98) * alike + np.sqrt(0.02) * own)
    signal = signal + rng.normal(0.0, MODEL.noise_counts, signal.shape)
    return LineSignals(place, signal, np.ones(signal.shape, bool), np.repeat(np.arange(presses), 3))


def drawn(rng: np.random.Generator, spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Gains (16,) that differ by a spread, and a pose (5,)."""
    return rng.normal(0.0, spread, 16), rng.normal(0.0, 0.6 * POSE_SIGMA)


def found(signals: LineSignals) -> GainFit:
    return fit_gains(signals, MODEL, DRAWN, NAMES, gain_sigma=GAIN, pose_sigma=POSE_SIGMA)


def away_from_mean(gain: np.ndarray) -> np.ndarray:
    """Gains (16,) minus the mean of rows, of columns."""
    return gain - np.repeat(gain.reshape(2, 8).mean(axis=1), 8)


def test_gains_are_found_where_lines_differ() -> None:
    rng = np.random.default_rng(1)
    gain, pose = drawn(rng, 0.04)
    fit = found(pressed(rng, 20, gain, pose))
    off = away_from_mean(fit.value - gain)
    assert np.sqrt(np.mean(off**2)) < 0.25 * np.std(away_from_mean(gain))
    assert np.all(np.abs(fit.value - gain) < 3.5 * fit.sigma)
    assert np.all(fit.relative_sigma < fit.sigma)
    assert fit.names == NAMES and len(fit.measures) == 16


def test_what_nothing_explains_lets_go() -> None:
    rng = np.random.default_rng(4)
    signals = pressed(rng, 10, np.zeros(16), np.zeros(5))
    wrong = signals.place_m + np.where(signals.press == 3, 3e-3, 0.0)[:, None]
    fit = found(LineSignals(wrong, signals.signal_counts, signals.told, signals.press))
    assert np.abs(fit.value).max() < 0.015


def test_a_line_that_says_nothing_is_as_uncertain_as_lines_differ() -> None:
    rng = np.random.default_rng(5)
    gain, pose = drawn(rng, 0.05)
    signals = pressed(rng, 8, gain, pose)
    told = signals.told.copy()
    told[:, 5] = False
    broken = np.where(told, signals.signal_counts, 1e5)
    fit = found(LineSignals(signals.place_m, broken, told, signals.press))
    assert 0.02 < fit.sigma[5] < 0.06 and np.abs(fit.value[5]) < 0.5 * fit.sigma[5]
    assert np.median(fit.relative_sigma) < 0.5 * fit.sigma[5]


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.04, 0.0])
def test_nine_in_ten_gains_are_within_their_intervals(spread: float) -> None:
    rng = np.random.default_rng(2)
    inside, relative = [], []
    for _ in range(15):
        gain, pose = drawn(rng, spread)
        fit = found(pressed(rng, 6, gain, pose))
        inside.append(np.abs(fit.value - gain) < 1.645 * fit.sigma)
        relative.append(np.abs(away_from_mean(fit.value - gain)) < 1.645 * fit.relative_sigma)
    # Where lines are alike, intervals hold them all: as likely as not they were thought to be.
    for each in (inside, relative):
        assert np.mean(each) > 0.84
        # Where lines are alike, the prior that says so makes intervals wider than they need be.
        assert spread < 0.02 or np.mean(each) < 0.96
