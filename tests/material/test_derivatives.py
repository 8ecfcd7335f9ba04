"""Stress, tangent and third derivative of every law, where stretches coincide and where they do not."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import special_ortho_group

from softfuse.material import AbstractMaterial

STEP = 1e-3
STENCIL = (np.array([-2, -1, 1, 2]), np.array([1, -8, 8, -1]) / 12)  # fourth order
ROTATIONS = special_ortho_group.rvs(3, size=4, random_state=3)
STRETCHES = np.array(
    [
        [1.0, 1.0, 1.0],
        [1.4, 1.4, 1.4],
        [1.5, 0.8, 0.8],
        [1.5, 1.5, 0.7],
        [1.3, 1.0, 0.9],
        [1.0, 1.0 + 1e-7, 1.0],
    ]
)
STATES = np.concatenate(
    [
        np.array([np.diag(s) for s in STRETCHES]),
        ROTATIONS[:2],
        np.einsum("ij,nj,kj->nik", ROTATIONS[0] @ ROTATIONS[1].T, STRETCHES, ROTATIONS[1]),
    ]
)
Jet = Callable[[AbstractMaterial, np.ndarray, np.ndarray], tuple[jax.Array, jax.Array, jax.Array, jax.Array]]


@jax.jit
def jet(law: AbstractMaterial, states: jax.Array, directions: jax.Array) -> tuple[jax.Array, ...]:
    """Energy, stress, tangent and the tangent's derivative along the direction, at every state (n, 3, 3)."""

    def at(state: jax.Array, direction: jax.Array) -> tuple[jax.Array, ...]:
        tangent, third = jax.jvp(jax.hessian(law.energy), (state,), (direction,))
        return *jax.value_and_grad(law.energy)(state), tangent, third

    return jax.vmap(at)(states, directions)


@pytest.fixture(scope="module")
def jets(law: AbstractMaterial) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Directions, derivatives at the states, and finite differences of each order along the directions."""
    directions = np.random.default_rng(5).standard_normal(STATES.shape)
    offsets, weights = STENCIL
    shifted = STATES + STEP * offsets[:, None, None, None] * directions
    everything = np.concatenate([STATES, shifted.reshape(-1, 3, 3)])
    values = [np.asarray(v) for v in jet(law, everything, np.tile(directions, (5, 1, 1)))]
    exact = [v[: len(STATES)] for v in values]
    moved = [v[len(STATES) :].reshape(4, len(STATES), *v.shape[1:]) for v in values]
    return directions, exact, [np.tensordot(weights, v, 1) / STEP for v in moved]


def test_everything_is_finite(jets: tuple) -> None:
    assert all(np.isfinite(value).all() for value in jets[1])


def test_stress_is_the_slope_of_the_energy(jets: tuple, mu: float) -> None:
    directions, (_, stress, _, _), (slope, _, _, _) = jets
    np.testing.assert_allclose(np.sum(stress * directions, axis=(1, 2)), slope, rtol=1e-7, atol=1e-7 * mu)


def test_tangent_is_the_slope_of_the_stress(jets: tuple, mu: float) -> None:
    directions, (_, _, tangent, _), (_, slope, _, _) = jets
    np.testing.assert_allclose(
        np.einsum("nijkl,nkl->nij", tangent, directions), slope, atol=1e-7 * mu, rtol=1e-7
    )


def test_third_derivative_is_the_slope_of_the_tangent(jets: tuple, mu: float) -> None:
    _, (_, _, _, third), (_, _, slope, _) = jets
    assert np.abs(third).max() > mu / 10
    np.testing.assert_allclose(third, slope, atol=1e-7 * mu, rtol=1e-7)


def test_tangent_is_symmetric(jets: tuple, mu: float) -> None:
    tangent = jets[1][2].reshape(-1, 9, 9)
    np.testing.assert_allclose(tangent, tangent.transpose(0, 2, 1), atol=1e-12 * np.abs(tangent).max())


def test_third_derivative_at_rest_and_in_full(law: AbstractMaterial, mu: float) -> None:
    states = jnp.stack([jnp.eye(3), jnp.asarray(ROTATIONS[0])])
    third = jax.jit(jax.vmap(jax.jacfwd(jax.hessian(law.energy))))(states).reshape(2, 9, 9, 9)
    assert np.isfinite(third).all()
    np.testing.assert_allclose(third, third.transpose(0, 3, 2, 1), atol=1e-10 * mu)
