"""Volumes that a known force changes, and its limits."""

import equinox as eqx
import jax.numpy as jnp
import pytest

from softfuse.estimation.limits import Limits
from softfuse.mechanics.model import simulate


@pytest.fixture(scope="session")
def volumes_under():
    """volumes_under(robot, places, force): volume changes (k,) at the equilibrium, compiled once."""
    return eqx.filter_jit(lambda d, at, force: d.reading(simulate(d, at, force).state))


@pytest.fixture(scope="session")
def one() -> Limits:
    """Limits of one contact."""
    return Limits(jnp.zeros(1), jnp.array([25.0]), jnp.array([1e-6]))
