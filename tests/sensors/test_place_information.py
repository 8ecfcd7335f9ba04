"""What electrodes tell of places: as their fits do, and differentiably in where the lines are."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import fit_anew, mutual_model, peak_model, peak_signal
from scipy.optimize import least_squares

from softfuse.sensors.mutual.model import one_signal
from softfuse.sensors.place_information import charge_of, place_told_by_grid, place_told_by_lines

LINES = 8e-3 * (np.arange(8) - 3.5)
WIDE = 16e-3 * (np.arange(4) - 1.5)
PLACES = jnp.array([[0.0, 0.0], [1e-3, -11e-3], [26e-3, 5e-3], [-29e-3, 29e-3]])


def stretched(model, by: float):
    """The model with lines so much farther apart."""
    return eqx.tree_at(
        lambda m: (m.row_y_m, m.column_x_m), model, (by * model.row_y_m, by * model.column_x_m)
    )


def test_lines_promise_what_a_fit_finds() -> None:
    model = peak_model(LINES, LINES, 1.5e-3, 1e-3)
    charge = charge_of(model, 3000.0)
    amplitude = jnp.full(2, charge / 8e-3**2)
    for place, told in zip(PLACES, place_told_by_lines(model, charge, PLACES), strict=True):
        signal = peak_signal(model, place, amplitude, jnp.zeros(2), model.radius_m, jnp.zeros(()))
        fit = fit_anew(model, signal, jnp.ones(16, bool))
        np.testing.assert_allclose(fit.location_m, place, atol=1e-6)
        np.testing.assert_allclose(
            np.linalg.inv(told), fit.covariance_m2, rtol=1e-3, atol=1e-6 * told.max() ** -1
        )


def test_the_strongest_line_of_a_contact_reads_what_is_asked() -> None:
    model = peak_model(LINES, LINES, 1.5e-3, 1e-3)
    amplitude = jnp.full(2, charge_of(model, 3000.0) / 8e-3**2)
    signal = peak_signal(model, jnp.zeros(2), amplitude, jnp.zeros(2), model.radius_m, jnp.zeros(()))
    assert signal.max() == pytest.approx(3000.0)


def test_a_grid_promises_the_spread_of_least_squares() -> None:
    model = mutual_model(WIDE, WIDE, electrode_width=16e-3)
    place, coupling = jnp.array([3e-3, -5e-3]), 0.6
    told = place_told_by_grid(model, coupling, place[None])[0]

    @jax.jit
    def signal(unknowns):
        return one_signal(model, unknowns[:2], jnp.ones(()), unknowns[2])

    exact = np.asarray(signal(jnp.append(place, coupling)))
    peak = max(np.abs(exact).max(), 1900.0 * np.hypot(1.0, coupling))
    sigma, common = np.hypot(8.0, 0.015 * peak), 0.015 * 1900.0
    rng, found = np.random.default_rng(1), []
    for _ in range(400):
        read = exact + sigma * rng.normal(size=exact.size) + common * rng.normal()

        def missed(u, read=read):
            off = np.asarray(signal(jnp.asarray(u[:3] * [1e-3, 1e-3, 1.0]))) + common * u[3] - read
            return np.append(off / sigma, u[3])

        found.append(least_squares(missed, [3.0, -5.0, 0.6, 0.0]).x[:2])
    promised = 1e6 * np.linalg.inv(told)
    np.testing.assert_allclose(np.cov(np.array(found).T), promised, atol=0.2 * promised.max())


@pytest.mark.parametrize("kind", ["lines", "grid"])
def test_what_is_told_has_the_derivatives_of_differences(kind) -> None:
    peak, grid = peak_model(LINES, LINES, 1.5e-3, 1e-3), mutual_model(WIDE, WIDE, electrode_width=16e-3)
    charge = charge_of(peak, 3000.0)

    @jax.jit
    def told(by):
        if kind == "lines":
            return place_told_by_lines(stretched(peak, by), charge, PLACES)
        return place_told_by_grid(stretched(grid, by), 0.6, PLACES)

    slope = jax.jacfwd(told)(1.0)
    difference = (told(1.0 + 1e-5) - told(1.0 - 1e-5)) / 2e-5
    np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(difference).max())
    backward = jax.grad(lambda by: jnp.sum(told(by)))(1.0)
    assert backward == pytest.approx(float(jnp.sum(slope)), rel=1e-9)


def test_there_is_a_best_pitch_for_a_surface() -> None:
    model = peak_model(LINES, LINES, 1.5e-3, 1e-3)
    charge = charge_of(model, 3000.0)
    x = np.linspace(-28e-3, 28e-3, 6)
    places = jnp.asarray(np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2))

    def error(by):
        covariance = jnp.linalg.inv(place_told_by_lines(stretched(model, by), charge, places))
        return float(jnp.sqrt(jnp.mean(jnp.trace(covariance, axis1=1, axis2=2))))

    near, drawn, far = (error(by) for by in (0.5, 1.0, 2.0))
    assert drawn < near and drawn < far
