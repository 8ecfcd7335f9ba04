"""A stiffness field in a device: its derivatives, and that presses tell it."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body.stiffness_field import TERMS, with_field
from softfuse.calibration.adjustment import Adjustments, Stiffness, StiffnessField
from softfuse.calibration.fit import fit
from softfuse.calibration.presses import Adjustable, Applied, Presses
from softfuse.functional.chart import facing
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import RESULTS

MADE = np.array([0.05, -0.03, 0.06, 0.02, -0.04, 0.03, -0.05, 0.04, 0.02])
POINTS = 1e-3 * np.array(
    [[-18, 4, 0], [16, -5, 0], [0, 2, 0], [-9, -8, 0], [22, 6, 0], [-24, -9, 0], [7, 9, 0], [-4, -3, 0]]
)
PLACES = facing(POINTS, (0, 0, -1))
FORCES = (2.0, 5.0)
AT = jnp.asarray(facing(np.array([[-0.012, 0.003, 0.0]]), (0, 0, -1)))


@pytest.fixture(scope="module")
def read(device: Model) -> Callable[..., tuple[jax.Array, RESULTS]]:
    """Volume changes under a press, of the field's coefficients."""

    def read(coefficients):
        body = with_field(device.body, coefficients)
        made = Model(body, device.readings, device.contacts, device.linear)
        solution = simulate(made, AT, jnp.array([5.0]))
        return made.reading(solution.state), solution.result

    return jax.jit(read)


@pytest.mark.slow
def test_volumes_differentiate_in_every_coefficient(read) -> None:
    slopes = jax.jit(jax.jacrev(lambda c: read(c)[0]))(jnp.asarray(MADE))
    h = 1e-4
    for k in range(len(TERMS)):
        (above, result), (below, _) = (read(jnp.asarray(MADE + side * h * np.eye(9)[k])) for side in (1, -1))
        assert bool(result == RESULTS.converged)
        difference = (above - below) / (2 * h)
        # A whole unit of each coefficient changes volumes by some part of them.
        assert np.abs(difference).max() > 1e-3 * np.abs(above).max()
        np.testing.assert_allclose(slopes[:, k], difference, atol=1e-5 * np.abs(above).max())


@pytest.mark.slow
def test_without_coefficients_a_field_changes_nothing(device: Model, read) -> None:
    found, _ = read(jnp.zeros(9))
    plain = simulate(device, AT, jnp.array([5.0]))
    np.testing.assert_allclose(found, device.reading(plain.state), rtol=1e-7)


@pytest.mark.slow
def test_presses_tell_the_field_that_a_device_was_made_with(plain_device: Model) -> None:
    groups = (Stiffness.within(0.3), StiffnessField.within(0.05, np.zeros(9)))
    adjustable = Adjustable(plain_device, Adjustments(groups))
    made, noise = np.append(0.2, MADE), 0.1e-9
    place, force = np.repeat(PLACES, len(FORCES), axis=0), np.tile(FORCES, len(PLACES))
    press = np.repeat(np.arange(len(PLACES)), len(FORCES))
    applied = Applied(place[:, None], force[:, None], np.zeros((len(force), 0)), press)
    reading = adjustable.answer(made, applied).reading
    noisy = reading + noise * np.random.default_rng(3).normal(size=reading.shape)
    found = fit(adjustable, Presses(applied, noisy, np.full_like(reading, noise)))
    told = dict(zip(found.names, found.told, strict=True))
    assert told["stiffness"] > 0.9 and told["stiffness field x"] > 0.9 and told["stiffness field y"] > 0.5
    off = found.value - made
    assert np.all(np.abs(off) < 3 * found.sigma)
    # 99.8 % of what chi² of ten parameters can be
    assert 1.5 < off @ np.linalg.solve(found.covariance, off) < 29.6
    assert float(np.sqrt(np.mean(found.after**2))) < 1.3 * noise
