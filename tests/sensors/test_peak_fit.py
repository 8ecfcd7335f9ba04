"""The location of a contact from the profiles of rows and columns."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_sensors import peak_model

from softfuse.sensors.capacitive import weighted_mean_location
from softfuse.sensors.crossed.peak_fit import fit_peak, fit_peak_of_honest
from softfuse.sensors.crossed.peak_model import peak_signal

LINES = (-28.0 + 8.0 * np.arange(8)) * 1e-3
MODEL = peak_model(LINES, LINES, 1.5e-3, 1.0e-3)
ALL = jnp.ones(16, bool)
AMPLITUDE = jnp.asarray([2700.0, 4500.0])
fit = jax.jit(fit_peak)
honest_fit = jax.jit(fit_peak_of_honest)


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


def test_noise_covariance_is_the_scatter_of_noisy_fits():
    signal = signal_of((13e-3, -28e-3))
    noisy = signal + 8.0 * jax.random.normal(jax.random.key(0), (400, 16))
    found = jax.jit(jax.vmap(lambda s: fit_peak(MODEL, s, ALL)))(noisy)
    predicted = np.sqrt(np.diagonal(np.asarray(fit(MODEL, signal, ALL).noise_covariance_m2)))
    scatter = np.std(np.asarray(found.location_m), axis=0)
    np.testing.assert_allclose(scatter, predicted, rtol=0.15)
    assert np.all(predicted < 0.05e-3)


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


def test_derivative_of_the_location_agrees_with_finite_differences():
    direction = 10.0 * jnp.sin(jnp.arange(16.0))
    signal = signal_of((9.3e-3, -15.6e-3)) + 5.0 * direction
    more = peak_model(LINES, LINES, 1.5e-3, 1.0e-3, iterations=30)
    x_of = jax.jit(lambda s: fit_peak(more, s, ALL).location_m[0])
    forward = jax.jit(lambda s: jax.jvp(x_of, (s,), (direction,))[1])(signal)
    reverse = jax.jit(jax.grad(x_of))(signal) @ direction
    h = 1e-2
    difference = (x_of(signal + h * direction) - x_of(signal - h * direction)) / (2.0 * h)
    assert float(forward) == pytest.approx(float(difference), rel=1e-5)
    assert float(reverse) == pytest.approx(float(forward), rel=1e-9)


def test_the_parameters_of_the_model_can_be_differentiated():
    signal = algebraic_disc_signal((25e-3, 3e-3))
    gradient = eqx.filter_jit(eqx.filter_grad(lambda m: fit_peak(m, signal, ALL).location_m[0]))(MODEL)
    shift = float(jnp.sum(gradient.column_x_m))
    assert shift == pytest.approx(1.0, rel=0.05)
    assert np.isfinite(float(gradient.row_depth_m)) and float(gradient.radius_m) != 0.0
