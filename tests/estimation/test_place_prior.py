"""Places that are not known exactly: found with the forces, as far as the readings tell them."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.limits import Limits
from softfuse.estimation.motion import motion
from softfuse.estimation.step import Observation, PlacePrior, exact_steps
from softfuse.functional.chart import facing, moved
from softfuse.mechanics.model import simulate
from softfuse.mechanics.newton import tangent_at

AT = jnp.asarray(facing(np.array([[-12e-3, 3e-3, 0.0]]), (0, 0, -1)))
SEEN_AT = moved(AT, jnp.array([[0.8e-3, -0.5e-3]]))
TRUE = jnp.array([6.0])
SIGMA = 1e-3
STEPS = 12


@pytest.fixture(scope="module")
def model(plain_device):
    """What the step does depends neither on the element nor on the linear solver."""
    return plain_device


@pytest.fixture(scope="module")
def read():
    """read(robot, places, drive): readings at the equilibrium, compiled once."""
    return eqx.filter_jit(lambda d, at, force: d.reading(simulate(d, at, force).state))


@pytest.fixture(scope="module")
def stepped():
    """stepped(robot, limits, seen): state and report after exact steps from rest, compiled once."""
    return eqx.filter_jit(
        lambda d, lim, seen: exact_steps(d, lim, d.rest_state(seen.places), seen, steps=STEPS)
    )


def prior(sigma: float, reach: float = 1.0, contacts: int = 1) -> PlacePrior:
    nowhere = jnp.zeros((contacts, 2))
    return PlacePrior(nowhere, sigma * jnp.eye(2 * contacts), nowhere - reach, nowhere + reach)


def observed(reading, sigma: float, reach: float = 1.0, at=SEEN_AT, white: float = 1e9) -> Observation:
    return Observation(reading, white * jnp.eye(len(reading)), at, prior(sigma, reach, len(at)))


@pytest.mark.parametrize("force", [0.5, 6.0])
def test_readings_move_with_a_place_as_full_solves_do(model, read, force: float) -> None:
    @eqx.filter_jit
    def slopes(d, at, drive):
        state = simulate(d, at, drive).state
        inverse = tangent_at(d.linear, d.body, d.loads(at), state)
        moving = motion(d, inverse, state, at, by_place=True, refinements=0)
        return moving.derivative(d.reading)[1]

    h, drive = 1e-6, jnp.array([force])
    found = slopes(model, AT, drive)
    assert found.shape == (2, 3)
    for axis in (0, 1):
        step = h * jnp.eye(2)[axis]
        wanted = read(model, moved(AT, step), drive) - read(model, moved(AT, -step), drive)
        wanted = wanted / (2 * h)
        np.testing.assert_allclose(found[:, 1 + axis], wanted, rtol=1e-5, atol=1e-9 * force)


def test_a_known_place_is_held(model, read, stepped, one) -> None:
    reading = read(model, AT, TRUE)
    state, report = stepped(model, one, observed(reading, 0.0))
    plain, known = stepped(model, one, Observation(reading, 1e9 * jnp.eye(2), SEEN_AT))
    np.testing.assert_allclose(state.drive, plain.drive, rtol=1e-9)
    np.testing.assert_allclose(report.offset, 0.0, atol=1e-15)
    np.testing.assert_allclose(report.misfit, known.misfit, atol=1e-18)


def test_steps_end_where_force_and_place_are_most_probable(model, read, stepped, unregularised) -> None:
    reading = read(model, AT, TRUE)
    state, report = stepped(model, unregularised, observed(reading, SIGMA))

    def cost(x):
        """Minus twice the logarithm of the posterior density, at a force [N] and an offset [mm]."""
        at = moved(SEEN_AT, 1e-3 * x[1:])
        missed = 1e9 * (reading - read(model, at, x[:1]))
        return float(missed @ missed + jnp.sum((1e-3 * x[1:] / SIGMA) ** 2))

    found = np.array([float(state.drive[0]), *(1e3 * np.asarray(report.offset[0]))])
    least, h = cost(found), 1e-3
    for axis in np.eye(3):
        up, down = cost(found + h * axis), cost(found - h * axis)
        curvature = (up - 2 * least + down) / h**2
        # From the best value along each axis it is less than a hundredth of the step away.
        assert abs((up - down) / (2 * h) / curvature) < 1e-2 * h
    slopes = 1e9 * np.hstack([report.compliance, SIGMA * np.asarray(report.by_place)])
    told = slopes.T @ slopes + np.diag([0.0, 1.0, 1.0])
    np.testing.assert_allclose(report.information, told, rtol=1e-6)
    # The readings were made nearer than the prior says.
    assert np.linalg.norm(found[1:]) > 0.1
    assert abs(found[0] - 6.0) < abs(
        float(stepped(model, unregularised, observed(reading, 0.0))[0].drive[0]) - 6.0
    )


def test_a_place_stays_within_its_reach(model, read, stepped, one) -> None:
    state, report = stepped(model, one, observed(read(model, AT, TRUE), 10 * SIGMA, reach=0.2e-3))
    assert float(report.kkt) < 1e-6
    # So much in every step.
    assert np.max(np.abs(np.asarray(report.offset))) <= STEPS * 0.2e-3 + 1e-12
    single = eqx.filter_jit(lambda d, seen: exact_steps(d, one, d.rest_state(seen.places), seen, steps=2))
    _, report = single(model, observed(read(model, AT, TRUE), 10 * SIGMA, reach=0.2e-3))
    assert np.max(np.abs(np.asarray(report.offset))) <= 0.4e-3 + 1e-12


@pytest.mark.slow
def test_forces_and_places_scatter_by_what_the_information_says(model, read, stepped, unregularised) -> None:
    """Noise of readings and of where the contact was seen, drawn from what the step is told."""
    rng, white = np.random.default_rng(5), 1e8
    reading, off = read(model, AT, TRUE), []
    for noise, seen in zip(rng.normal(size=(200, 2)), rng.normal(size=(200, 2)), strict=True):
        at = moved(AT, 0.3 * SIGMA * jnp.asarray(seen))
        observation = observed(reading + noise / white, 0.3 * SIGMA, at=at, white=white)
        state, report = stepped(model, unregularised, observation)
        sigma = np.sqrt(np.diag(np.linalg.inv(report.information))) * np.array(
            [1.0, 0.3 * SIGMA, 0.3 * SIGMA]
        )
        place = at[0, 0, :2] + report.offset[0] - AT[0, 0, :2]
        off.append(np.array([float(state.drive[0]) - 6.0, *place]) / sigma)
    # Three standard deviations of a standard deviation from 200 draws: 15 %.
    np.testing.assert_allclose(np.std(off, axis=0), 1.0, atol=0.15)


@pytest.fixture(scope="module")
def unregularised() -> Limits:
    return Limits(jnp.zeros(1), jnp.array([25.0]), jnp.zeros(1))
