"""A shape is as sure as the force and place that make it: against full solves."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.uncertainty import displacement_sigma
from softfuse.functional.chart import facing, moved
from softfuse.mechanics.model import simulate

AT, FORCE = jnp.asarray(facing(np.array([[-12e-3, 3e-3, 0.0]]), (0, 0, -1))), jnp.array([4.0])


@pytest.fixture(scope="module")
def shape():
    """shape(robot, places, drive): displacements (k, 3) m at the equilibrium, compiled once."""
    return eqx.filter_jit(lambda d, at, force: d.body.displacement(simulate(d, at, force).state.z))


@pytest.fixture(scope="module")
def state(plain_device):
    return simulate(plain_device, AT, FORCE).state


def test_a_force_alone(plain_device, shape, state) -> None:
    found = displacement_sigma(plain_device, state, AT, np.array([[0.09]]))
    h = 1e-4
    slope = (shape(plain_device, AT, FORCE + h) - shape(plain_device, AT, FORCE - h)) / (2 * h)
    np.testing.assert_allclose(found, 0.3 * np.abs(slope), rtol=1e-5, atol=1e-12)


def test_force_and_place_that_err_together(plain_device, shape, state) -> None:
    """As the shapes scatter of solves at forces and places drawn from the covariance."""
    unit = np.diag([1e-3, 1e-5, 2e-5])
    root = unit @ np.array([[1.0, 0.0, 0.0], [0.7, 0.7, 0.0], [-0.5, 0.2, 0.8]])
    found = displacement_sigma(plain_device, state, AT, root @ root.T)
    # Symmetric pairs along each column of a root: their halved differences squared add up to the variance.
    shapes = [
        (shape(plain_device, moved(AT, jnp.asarray(each[1:])), FORCE + each[0])
         - shape(plain_device, moved(AT, jnp.asarray(-each[1:])), FORCE - each[0])) / 2
        for each in root.T
    ]  # fmt: skip
    expected = np.sqrt(sum(np.asarray(each) ** 2 for each in shapes))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4 * expected.max())


def test_what_is_known_is_sure(plain_device, state) -> None:
    assert not displacement_sigma(plain_device, state, AT, np.zeros((3, 3))).any()
