"""Equilibria from nearby ones, against Newton's method with new factors and load steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.functional.chart import facing
from softfuse.mechanics import RESULTS
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import State
from softfuse.rom.equilibria import follow, rough_factor, step_to

PLACE = jnp.asarray(facing(np.array([[-12e-3, 3e-3, 0.0]]), (0, 0, -1)))


@eqx.filter_jit
def followed(device: Model, place, drive, start: State, factor):
    """`follow` on a device."""
    return follow(device.linear, device.body, device.loads(place), drive, start, factor)


@eqx.filter_jit
def factor_of(device: Model, place, state: State):
    """`rough_factor` on a device."""
    return rough_factor(device.linear, device.body, device.loads(place), state)


@eqx.filter_jit
def stepped(device: Model, place, drive, state: State, factor):
    """`step_to` on a device."""
    return step_to(device.linear, device.body, device.loads(place), drive, state, factor)[0]


@pytest.mark.slow
def test_an_equilibrium_is_the_one_that_newtons_method_finds(device) -> None:
    rest = device.rest_state(PLACE)
    factor, state = factor_of(device, PLACE, rest), rest
    for force in (3.0, 6.0):
        found = followed(device, PLACE, jnp.array([force]), state, factor)
        assert bool(found.converged)
        state, factor = found.state, found.factor
    exact = simulate(device, PLACE, jnp.array([6.0]))
    assert exact.result == RESULTS.converged
    moves = slice(0, device.body.n_displacements)
    np.testing.assert_allclose(state.z[moves], exact.state.z[moves], atol=1e-10)
    np.testing.assert_allclose(state.force, exact.state.force, atol=1e-5)


def test_fewer_factors_than_steps(device) -> None:
    rest = device.rest_state(PLACE)
    found = followed(device, PLACE, jnp.array([4.0]), rest, factor_of(device, PLACE, rest))
    assert bool(found.converged)
    assert 0 < int(found.factors) < int(found.steps)


def test_one_step_to_a_neighbour_misses_it_by_the_square_of_the_distance(device) -> None:
    rest = device.rest_state(PLACE)
    at = followed(device, PLACE, jnp.array([5.0]), rest, factor_of(device, PLACE, rest)).state
    factor = factor_of(device, PLACE, at)
    missed = []
    for distance in (1.0, 0.5, 0.25):
        drive = jnp.array([5.0 + distance])
        exact = simulate(device, PLACE, drive).state.z
        missed.append(float(jnp.max(jnp.abs(stepped(device, PLACE, drive, at, factor).z - exact))))
    slopes = np.diff(np.log(missed)) / np.log(0.5)
    assert np.all(slopes > 1.7)


def test_a_load_that_the_body_cannot_carry_is_not_converged(device) -> None:
    rest = device.rest_state(PLACE)
    found = followed(device, PLACE, jnp.array([4000.0]), rest, factor_of(device, PLACE, rest))
    assert not bool(found.converged)


@pytest.mark.slow
def test_it_is_pure_and_can_be_vectorised(plain_device) -> None:
    rest = plain_device.rest_state(PLACE)
    factor = factor_of(plain_device, PLACE, rest)
    drives = jnp.array([[1.0], [2.0]])
    both = jax.vmap(lambda drive: followed(plain_device, PLACE, drive, rest, factor))(drives)
    for k, drive in enumerate(drives):
        alone = followed(plain_device, PLACE, drive, rest, factor)
        np.testing.assert_allclose(both.state.z[k], alone.state.z, atol=1e-9)


@pytest.mark.parametrize("force", [1.0, 3.0])
def test_where_it_starts_does_not_matter(plain_device, force) -> None:
    rest = plain_device.rest_state(PLACE)
    factor = factor_of(plain_device, PLACE, rest)
    drive = jnp.array([force])
    direct = followed(plain_device, PLACE, drive, rest, factor)
    above = followed(plain_device, PLACE, jnp.array([4.0]), rest, factor)
    back = followed(plain_device, PLACE, drive, above.state, above.factor)
    assert bool(direct.converged) and bool(back.converged)
    np.testing.assert_allclose(direct.state.z, back.state.z, atol=1e-9)
