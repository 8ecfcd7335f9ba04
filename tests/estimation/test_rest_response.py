"""Answers at rest are the slopes of equilibria, with the derivatives that differences of re-solves have."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.rest_response import place_response, rest_response
from softfuse.functional.chart import facing, moved
from softfuse.mechanics.model import Model, compliance, simulate
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot

PLACES = jnp.asarray(facing(np.array([[0.012, -0.015, 0.0], [-0.003, 0.004, 0.0]]), (0, 0, -1)))
SMALL_N = 1e-3
"""Its answer differs from that at rest by some 1e-4."""


@pytest.fixture(scope="module")
def model(coarse) -> Model:
    """The pad on the coarsest mesh."""
    return build_robot(load(coarse)).model


@pytest.mark.slow
def test_it_is_the_compliance_at_rest(model) -> None:
    answer = rest_response(model, PLACES)
    for k, place in enumerate(PLACES):
        slope = compliance(model, place[None], jnp.array([1e-2 * SMALL_N]))[:, 0]
        np.testing.assert_allclose(answer.by_force[k], slope, rtol=1e-5)


@pytest.mark.slow
def test_depth_and_motion_are_those_of_a_small_press(model) -> None:
    answer = rest_response(model, PLACES[:1])
    state = simulate(model, PLACES[:1], jnp.array([SMALL_N])).state
    np.testing.assert_allclose(answer.softness[0], model.depth(PLACES[:1], state) / SMALL_N, rtol=1e-3)
    moved = model.body.displacement(state.z) / SMALL_N
    size = float(jnp.max(jnp.abs(moved)))
    np.testing.assert_allclose(answer.motion[0], moved, rtol=0, atol=1e-3 * size)


@pytest.mark.slow
def test_it_has_the_derivatives_in_rest_nodes_and_materials(model) -> None:
    rng = np.random.default_rng(0)
    # The top stays flat: a rigid disc on an uneven one would rest on single cells.
    rest = np.asarray(model.body.rest)
    in_plane = np.array([1.0, 1.0, 0.0])
    along = 1e-4 * rng.standard_normal(rest.shape)
    along = jnp.asarray(np.where(rest[:, 2:] > rest[:, 2].max() - 1e-9, in_plane * along, along))
    weights = jnp.asarray(rng.standard_normal((len(PLACES), model.n_readings)))

    @jax.jit
    def weighed(step):
        body = model.body.with_rest(model.body.rest + step * along)
        answer = rest_response(eqx.tree_at(lambda d: d.body, model, body), PLACES)
        return jnp.sum(weights * answer.by_force) * 1e9 + jnp.sum(answer.softness) * 1e3

    step = 1e-3
    difference = (weighed(step) - weighed(-step)) / (2 * step)
    np.testing.assert_allclose(jax.jvp(weighed, (0.0,), (1.0,))[1], difference, rtol=1e-5)
    np.testing.assert_allclose(jax.grad(weighed)(0.0), difference, rtol=1e-5)


def test_it_has_the_derivatives_in_places(model) -> None:
    answer, slope = place_response(model, PLACES)
    np.testing.assert_allclose(answer.by_force, rest_response(model, PLACES).by_force, rtol=1e-12)
    step = 1e-6
    for axis in range(2):
        shift = step * jnp.eye(2)[axis]
        after, before = (rest_response(model, moved(PLACES, sign * shift)).by_force for sign in (1, -1))
        size = float(jnp.max(jnp.abs(slope)))
        np.testing.assert_allclose(slope[..., axis], (after - before) / (2 * step), rtol=0, atol=1e-4 * size)
