"""The location of a contact from the profiles of rows and columns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_sensors import fit_anew, peak_model, peak_signal

from softfuse.sensors.capacitive import weighted_mean_location
from softfuse.sensors.crossed.peak_follow import follow_peak, no_peak

LINES = (-28.0 + 8.0 * np.arange(8)) * 1e-3
MODEL = peak_model(LINES, LINES, 1.5e-3, 1.0e-3)
ALL = jnp.ones(16, bool)
AMPLITUDE = jnp.asarray([2700.0, 4500.0])
fit = jax.jit(fit_anew)


@jax.jit
def honest_fit(model, signal, valid):
    """What is found, and who is honest, after as many equal frames as a search for one that lies takes."""

    def step(carry, _):
        track, honest = carry
        track, found, fair = follow_peak(model, track, signal, honest)
        return (track, honest & fair), found

    (_, honest), found = jax.lax.scan(step, (no_peak(model), valid), None, length=20)
    return jax.tree.map(lambda each: each[-1], found), honest


def signal_of(location, radius=10e-3, gap=0.0, amplitude=AMPLITUDE, offset=(40.0, 70.0)):
    return peak_signal(
        MODEL, jnp.asarray(location), amplitude, jnp.asarray(offset), jnp.asarray(radius), jnp.asarray(gap)
    )


def algebraic_disc_signal(location, cell=0.5e-3):
    """A profile from another physics: a disc with an algebraic edge, summed over diamonds on a grid."""
    middle = np.arange(-32e-3 + cell / 2, 32e-3, cell)
    x, y = np.meshgrid(middle, middle, indexing="ij")
    column, row = (np.clip(((v + 32e-3) // 8e-3).astype(int), 0, 7) for v in (x, y))
    belongs_to_column = np.abs(x - LINES[column]) < np.abs(y - LINES[row])
    u = (np.hypot(x - location[0], y - location[1]) - 10.3e-3) / 1.5e-3
    density = 0.5 * (1.0 - u / np.sqrt(1.0 + u * u))
    columns = [(density * (belongs_to_column & (column == k))).sum() for k in range(8)]
    rows = [(density * (~belongs_to_column & (row == k))).sum() for k in range(8)]
    return jnp.asarray(np.concatenate([0.6 * np.array(rows), np.array(columns)]) * 16.0)


@given(x=st.floats(-30e-3, 30e-3), y=st.floats(-30e-3, 30e-3), strength=st.floats(0.3, 3.0))
@settings(max_examples=40)
def test_the_expected_indenter_is_found_without_bias_up_to_the_border(x, y, strength):
    found = fit(MODEL, signal_of((x, y), amplitude=strength * AMPLITUDE), ALL)
    assert np.hypot(*(np.asarray(found.location_m) - [x, y])) < 0.03e-3


@given(
    x=st.floats(-30e-3, 30e-3),
    y=st.floats(-30e-3, 30e-3),
    radius=st.floats(9.0e-3, 11.0e-3),
    gap=st.floats(-0.2e-3, 0.5e-3),
)
@settings(max_examples=40)
def test_another_radius_and_gap_stay_within_what_the_covariance_says(x, y, radius, gap):
    found = fit(MODEL, signal_of((x, y), radius, gap), ALL)
    error = np.asarray(found.location_m) - [x, y]
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.diagonal(np.asarray(found.covariance_m2))))
    if max(abs(x), abs(y)) < 22e-3:
        assert np.hypot(*error) < 0.1e-3


def test_border_bias_is_that_of_the_weighted_mean_only():
    for location in [(28e-3, 0.0), (28e-3, 28e-3), (-28e-3, 21.8e-3)]:
        signal = signal_of(location, offset=(0.0, 0.0))
        mean = weighted_mean_location(MODEL.row_y_m, MODEL.column_x_m, signal, ALL)
        assert np.hypot(*(np.asarray(mean) - location)) > 2e-3
        assert np.all(np.abs(mean) < np.abs(np.asarray(location)) + 1e-9)
        assert np.hypot(*(np.asarray(fit(MODEL, signal, ALL).location_m) - location)) < 0.02e-3


def test_weighted_mean_is_right_in_the_middle():
    mean = weighted_mean_location(MODEL.row_y_m, MODEL.column_x_m, signal_of((0.0, 0.0)), ALL)
    np.testing.assert_allclose(mean, 0.0, atol=1e-9)


def test_a_profile_of_another_physics_is_located_within_a_twentieth_of_the_pitch():
    grid = np.linspace(-28e-3, 28e-3, 10)
    points = np.array([(x, y) for x in grid for y in grid[::3]])
    error = [
        np.hypot(*(np.asarray(fit(MODEL, algebraic_disc_signal(p), ALL).location_m) - p)) for p in points
    ]
    assert np.mean(error) < 0.4e-3
    assert np.max(error) < 1.0e-3


def test_total_covariance_covers_another_physics_within_a_factor_of_three():
    points = [(x, y) for x in np.linspace(-20e-3, 20e-3, 7) for y in (-17e-3, 1e-3, 9e-3)]
    normalised = []
    for p in points:
        found = fit(MODEL, algebraic_disc_signal(p), ALL)
        error = np.asarray(found.location_m) - p
        normalised.append(error @ np.linalg.solve(np.asarray(found.covariance_m2), error) / 2.0)
    assert np.sqrt(np.mean(normalised)) < 3.0


@pytest.mark.parametrize("broken", range(16))
@pytest.mark.parametrize("location", [(4.1e-3, -6.3e-3), (27e-3, 26e-3)])
def test_a_missing_electrode_costs_little(broken, location):
    signal = signal_of(location).at[broken].set(jnp.nan)
    found = fit(MODEL, signal, ALL.at[broken].set(False))
    assert np.hypot(*(np.asarray(found.location_m) - location)) < 0.15e-3
    assert float(found.covariance_m2[0, 0]) >= 0.0


@pytest.mark.parametrize("lie", [4000.0, 1500.0, -2000.0])
@pytest.mark.parametrize("liar", range(16))
def test_an_electrode_that_lies_is_found_and_left_out(liar, lie):
    location = np.array([5.0e-3, -11.0e-3])
    found, honest = honest_fit(MODEL, signal_of(location).at[liar].add(lie), ALL)
    assert np.hypot(*(np.asarray(found.location_m) - location)) < 0.1e-3
    assert not bool(honest[liar])
    assert int(honest.sum()) == 15


@pytest.mark.parametrize("broken", range(16))
def test_an_electrode_that_no_longer_answers_is_harmless(broken):
    location = np.array([-20.0e-3, 13.0e-3])
    found, honest = honest_fit(MODEL, signal_of(location).at[broken].set(0.0), ALL)
    assert np.hypot(*(np.asarray(found.location_m) - location)) < 0.3e-3


def test_an_unusual_profile_loses_no_electrode():
    for location in [(0.0, 0.0), (12e-3, -5e-3), (28e-3, 3e-3), (-28e-3, -28e-3)]:
        _, honest = honest_fit(MODEL, algebraic_disc_signal(location), ALL)
        assert bool(jnp.all(honest))


def test_without_electrodes_the_fit_is_finite_and_says_that_it_knows_nothing():
    found = fit(MODEL, jnp.full(16, jnp.nan), ~ALL)
    assert np.all(np.isfinite(np.asarray(found.location_m)))
    assert float(jnp.sqrt(found.covariance_m2[0, 0])) > 30e-3
