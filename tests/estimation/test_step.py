"""The estimate step: iterated it is the converged estimate, and its gradients are those of the optimum."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.limits import Limits
from softfuse.estimation.nonlinear import nonlinear_estimate
from softfuse.estimation.step import Observation, exact_steps
from softfuse.functional.chart import facing
from softfuse.mechanics.model import compliance, simulate


@pytest.fixture(scope="module")
def model(plain_device):
    """What the step does depends neither on the element nor on the linear solver."""
    return plain_device


AT = jnp.asarray(facing(np.array([[-12e-3, 3e-3, 0.0]]), (0, 0, -1)))
TRUE = jnp.array([6.0])
STEPS = 6


def _observation(change, at=AT) -> Observation:
    return Observation(change, 1e9 * jnp.eye(len(change)), at)


@pytest.fixture(scope="module")
def seen(model, volumes_under) -> Observation:
    """Volumes of a 6 N press, falsified so that no force explains them exactly."""
    change = volumes_under(model, AT, TRUE)
    return _observation(change + 2e-9 * jnp.array([1.0, -1.0]))


@pytest.fixture(scope="module")
def unregularised() -> Limits:
    return Limits(jnp.zeros(1), jnp.array([25.0]), jnp.zeros(1))


@pytest.fixture(scope="module")
def stepped():
    """stepped(robot, limits, seen): state and report after six exact steps from rest, compiled once."""
    return eqx.filter_jit(
        lambda d, lim, seen: exact_steps(d, lim, d.rest_state(seen.places), seen, steps=STEPS)
    )


@pytest.fixture(scope="module")
def converged():
    """converged(robot, limits, seen): the nonlinear estimate, compiled once."""
    return eqx.filter_jit(lambda d, lim, seen: nonlinear_estimate(d, lim, d.rest_state(seen.places), seen))


def test_steps_recover_a_known_force(model, volumes_under, stepped, one) -> None:
    state, report = stepped(model, one, _observation(volumes_under(model, AT, TRUE)))
    np.testing.assert_allclose(state.drive, TRUE, rtol=1e-9)
    assert float(jnp.max(jnp.abs(report.misfit))) < 1e-15  # m³, of some 1e-7
    assert float(report.unbalanced) < 1e-9


def test_iterated_steps_are_the_converged_estimate(model, stepped, converged, unregularised, seen) -> None:
    found = converged(model, unregularised, seen)
    state, _ = stepped(model, unregularised, seen)
    assert bool(found.converged)
    # Gauss-Newton ends where Wᵀ R⁻¹ e = 0, which the misfit keeps from being trivially so.
    np.testing.assert_allclose(state.drive, found.drive, rtol=1e-7)


def test_force_limits_hold(model, stepped, converged, seen) -> None:
    limits = Limits(jnp.zeros(1), jnp.array([4.0]), jnp.zeros(1))
    state, report = stepped(model, limits, seen)
    np.testing.assert_allclose(state.drive, [4.0], rtol=1e-12)
    assert float(report.kkt) < 1e-9
    np.testing.assert_allclose(converged(model, limits, seen).drive, [4.0], rtol=1e-12)
    pulled = eqx.tree_at(lambda s: s.reading, seen, -seen.reading)
    np.testing.assert_allclose(stepped(model, limits, pulled)[0].drive, [0.0], atol=1e-12)


def test_a_cavity_without_weight_is_ignored(model, volumes_under, stepped, one) -> None:
    change = volumes_under(model, AT, TRUE)
    broken = Observation(change.at[1].set(jnp.nan), jnp.diag(jnp.array([1e9, 0.0])), AT)
    np.testing.assert_allclose(stepped(model, one, broken)[0].drive, TRUE, rtol=1e-7)


def test_compliance_is_the_slope_of_the_volumes(model, volumes_under) -> None:
    w = eqx.filter_jit(compliance)(model, AT, TRUE)
    h = 1e-4
    difference = (volumes_under(model, AT, TRUE + h) - volumes_under(model, AT, TRUE - h)) / (2 * h)
    np.testing.assert_allclose(w[:, 0], difference, rtol=1e-6)


def _parameters(model, seen, factor, shift, extra):
    """Model with all shear moduli times a factor, a contact shifted along x, one volume changed."""
    softer = eqx.tree_at(
        lambda d: d.body.materials, model, jax.tree.map(lambda leaf: factor * leaf, model.body.materials)
    )
    moved = Observation(seen.reading.at[0].add(extra), seen.whitening, seen.places.at[0, 0, 0].add(shift))
    return softer, moved


@pytest.mark.slow
def test_unrolled_and_implicit_gradients_agree_with_differences(
    model, stepped, converged, unregularised, seen
) -> None:
    @eqx.filter_jit
    def unrolled(theta):
        d, s = _parameters(model, seen, *theta)
        return exact_steps(d, unregularised, d.rest_state(seen.places), s, steps=STEPS)[0].drive[0]

    @eqx.filter_jit
    def implicit(theta):
        d, s = _parameters(model, seen, *theta)
        return nonlinear_estimate(d, unregularised, d.rest_state(seen.places), s).drive[0]

    theta = jnp.array([1.0, 0.0, 0.0])
    steps = jnp.diag(jnp.array([1.0, 1e-3, 1e-9]))  # 1, 1 mm, 1 mm³
    along = {
        f: eqx.filter_jit(lambda way, f=f: jax.jvp(f, (theta,), (way,))[1]) for f in (unrolled, implicit)
    }
    by_steps, by_optimum = (np.array([along[f](way) for way in steps]) for f in (unrolled, implicit))
    h = 1e-4
    difference = [(implicit(theta + h * way) - implicit(theta - h * way)) / (2 * h) for way in steps]
    np.testing.assert_allclose(by_optimum, difference, rtol=2e-5)
    np.testing.assert_allclose(by_steps, by_optimum, rtol=1e-6)
    # All moduli times k: the force times k.
    np.testing.assert_allclose(by_optimum[0], implicit(theta), rtol=1e-8)


def test_two_contacts_at_once(model) -> None:
    places = jnp.asarray(facing(np.array([[-17e-3, 0.0, 0.0], [15e-3, 4e-3, 0.0]]), (0, 0, -1)))
    true = jnp.array([7.0, 3.0])
    limits = Limits(jnp.zeros(2), jnp.array([25.0, 25.0]), jnp.full(2, 1e-6))
    change = eqx.filter_jit(lambda d: d.reading(simulate(d, places, true).state))(model)
    state, _ = eqx.filter_jit(
        lambda d, seen: exact_steps(d, limits, d.rest_state(seen.places), seen, steps=STEPS)
    )(model, _observation(change, places))
    np.testing.assert_allclose(state.drive, true, rtol=1e-7)


def test_readings_that_err_together_are_weighed_together(model, volumes_under, stepped, one) -> None:
    """What errs alike in both volumes must not move the force, where the difference of the two tells it."""
    change = volumes_under(model, AT, TRUE)
    common = jnp.array([1.0, 1.0])
    covariance = 1e-20 * jnp.eye(2) + 1e-12 * jnp.outer(common, common)
    white = jnp.linalg.inv(jnp.linalg.cholesky(covariance))
    state, _ = stepped(model, one, Observation(change + 3e-9 * common, white, AT))
    np.testing.assert_allclose(state.drive, TRUE, rtol=1e-5)
    plain, _ = stepped(model, one, _observation(change + 3e-9 * common))
    assert abs(float(plain.drive[0]) - 6.0) > 0.05


@pytest.mark.slow
def test_forces_scatter_by_what_the_information_says(model, volumes_under, stepped, one) -> None:
    change = volumes_under(model, AT, TRUE)
    covariance = 1e-18 * jnp.array([[4.0, 1.5], [1.5, 1.0]])
    factor = jnp.linalg.cholesky(covariance)
    white = jnp.linalg.inv(factor)
    noise = np.random.default_rng(3).normal(size=(300, 2))
    drives = []
    for each in noise:
        state, report = stepped(model, one, Observation(change + factor @ each, white, AT))
        drives.append(float(state.drive[0]))
    sigma = float(report.information[0, 0]) ** -0.5
    # Three standard deviations of a standard deviation from 300 draws: 12 %.
    np.testing.assert_allclose(np.std(drives), sigma, rtol=0.12)
    assert abs(np.mean(drives) - 6.0) < 4 * sigma / np.sqrt(300)
