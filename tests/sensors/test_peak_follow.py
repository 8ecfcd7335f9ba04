"""A contact's location followed from frame to frame, and the search for an electrode that lies."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import fit_anew, peak_model, peak_signal

from softfuse.sensors.crossed.peak_follow import follow_peak, no_peak

LINES = (-28.0 + 8.0 * np.arange(8)) * 1e-3
MODEL = peak_model(LINES, LINES, 1.5e-3, 1.0e-3)
ALL = np.ones(16, bool)
AMPLITUDE = np.array([2700.0, 4500.0])
follow = jax.jit(lambda track, signal, valid: follow_peak(MODEL, track, signal, valid))
fit = jax.jit(lambda signal, valid: fit_anew(MODEL, signal, valid))
signal_at = jax.jit(
    lambda at, strength, gap: peak_signal(
        MODEL, at, strength * AMPLITUDE, jnp.array([40.0, 70.0]), jnp.asarray(10e-3), gap
    )
)


def noisy(signals, seed=0):
    """Frames (f, 16) with the noise of the counts."""
    return np.asarray(signals) + np.random.default_rng(seed).normal(0.0, 8.0, (len(signals), 16))


def run(signals, valid=ALL):
    """All frames: locations (f, 2), who is honest (f, 16)."""
    track, where, honest = no_peak(MODEL), [], []
    for signal in signals:
        track, found, fair = follow(track, signal, valid)
        valid = valid & np.asarray(fair)
        where.append(found.location_m)
        honest.append(valid)
    return np.array(where), np.array(honest)


def pressed(frames, way_m=(0.0, 0.0), at=(5e-3, -11e-3)):
    """A contact that grows in strength, sinks in and slides along a way."""
    share = np.linspace(0.0, 1.0, frames)
    return [signal_at(np.array(at) + s * np.array(way_m), 0.8 + 0.6 * s, 0.2e-3 - 0.3e-3 * s) for s in share]


@pytest.mark.parametrize("way", [(0.0, 0.0), (12e-3, 9e-3), (22e-3, -16e-3)])
def test_what_is_followed_is_what_a_fit_anew_finds(way):
    signals = noisy(pressed(60, way))
    where, honest = run(signals)
    anew = np.array([fit(signal, ALL).location_m for signal in signals])
    apart = np.hypot(*(where - anew).T)
    assert np.median(apart) < 0.3e-6
    assert np.mean(apart > 1e-6) < 0.1
    assert apart.max() < 10e-6
    assert honest.all()


def test_the_covariance_is_that_of_a_fit_anew():
    signal = noisy(pressed(2))[0]
    track, _, _ = follow(no_peak(MODEL), signal, ALL)
    _, followed, _ = follow(track, signal, ALL)
    expected = fit(signal, ALL)
    for name in ("covariance_m2", "residual_counts", "unknowns"):
        found, wanted = (np.asarray(getattr(each, name)) for each in (followed, expected))
        np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-3 * np.abs(wanted).max())


def test_a_jump_is_found_again_in_the_same_frame():
    here, there = (noisy([signal_at(np.array(at), 1.0, 0.0)] * 3) for at in ((-20e-3, 7e-3), (17e-3, -23e-3)))
    where, honest = run([*here, *there])
    np.testing.assert_allclose(where[3:], np.broadcast_to([17e-3, -23e-3], (3, 2)), atol=0.1e-3)
    assert honest.all()


@pytest.mark.parametrize("before", [0, 5])
@pytest.mark.parametrize(
    ("liar", "lie"), [(2, 4000.0), (5, 1500.0), (7, -2000.0), (13, 4000.0), (15, 1500.0)]
)
def test_an_electrode_that_lies_is_named_seventeen_frames_later(before, liar, lie):
    signals = noisy([signal_at(np.array([5e-3, -11e-3]), 1.0, 0.0)] * (before + 25))
    signals[before:, liar] += lie
    where, honest = run(signals)
    assert honest[: before + 17].all()
    others = np.arange(16) != liar
    assert honest[:, others].all() and not honest[before + 17 :, liar].any()
    assert np.hypot(*(where[before + 17 :] - [5e-3, -11e-3]).T).max() < 0.2e-3


def test_one_unlucky_frame_begins_no_search_that_lasts():
    signals = noisy([signal_at(np.array([5e-3, -11e-3]), 1.0, 0.0)] * 40)
    signals[10, 4] += 3000.0
    where, honest = run(signals)
    assert honest.all()
    assert np.hypot(*(where[12:] - [5e-3, -11e-3]).T).max() < 0.1e-3


def test_after_frames_without_sense_the_contact_is_found_again():
    signals = noisy([signal_at(np.array([5e-3, -11e-3]), 1.0, 0.0)] * 12)
    signals[3:6] = np.random.default_rng(3).normal(0.0, 3000.0, (3, 16))
    where, honest = run(signals)
    assert np.isfinite(where).all() and honest.all()
    assert np.hypot(*(where[7:] - [5e-3, -11e-3]).T).max() < 0.1e-3


def test_without_electrodes_all_stays_finite():
    where, _ = run(np.full((20, 16), np.nan), ~ALL)
    assert np.isfinite(where).all()
