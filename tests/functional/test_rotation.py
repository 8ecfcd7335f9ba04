"""The rotation in a deformation gradient, against singular values and scipy's rotations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from softfuse.functional.orientation import cross_matrix, polar_rotation, quaternion, rotation_vector

_polar = jax.jit(polar_rotation)
_slope = jax.jit(lambda f, df: jax.jvp(polar_rotation, (f,), (df,))[1])


def _gradient(seed: int, stretches: tuple[float, float, float]) -> np.ndarray:
    axes, turn = (Rotation.random(rng=seed + k).as_matrix() for k in range(2))
    return turn @ axes @ np.diag(stretches) @ axes.T


@pytest.mark.parametrize("stretches", [(1, 1, 1), (1, 1, 3), (0.1, 1, 10), (0.5, 0.500001, 2)])
def test_polar_factor_is_that_of_singular_values(stretches) -> None:
    for seed in range(3):
        f = _gradient(seed, stretches)
        np.testing.assert_allclose(_polar(jnp.asarray(f)), polar(f)[0], atol=1e-14)


@pytest.mark.parametrize("stretches", [(1, 1, 1), (1.2, 1.2, 0.7), (0.5, 1, 2)])
def test_polar_factor_has_the_slope_of_differences_also_at_rest(stretches) -> None:
    f, h = _gradient(5, stretches), 1e-6
    for seed in range(3):
        df = np.random.default_rng(seed).normal(size=(3, 3))
        difference = (polar(f + h * df)[0] - polar(f - h * df)[0]) / (2 * h)
        np.testing.assert_allclose(_slope(jnp.asarray(f), jnp.asarray(df)), difference, atol=2e-9)
    second = jax.jvp(lambda x: _slope(x, df), (jnp.asarray(f),), (jnp.asarray(df),))[1]
    twice = (polar(f + 1e-4 * df)[0] - 2 * polar(f)[0] + polar(f - 1e-4 * df)[0]) / 1e-8
    np.testing.assert_allclose(second, twice, atol=1e-6)


def test_vectors_and_quaternions_are_those_of_scipy() -> None:
    for angle in (1e-9, 0.1, 1.5, 3.1, np.pi - 1e-9):
        for axis in (*np.eye(3), *-np.eye(3), *np.random.default_rng(0).normal(size=(3, 3))):
            turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
            r = jnp.asarray(turn.as_matrix())
            np.testing.assert_allclose(rotation_vector(r), turn.as_rotvec(), atol=1e-12)
            expected = turn.as_quat(canonical=True, scalar_first=True)
            np.testing.assert_allclose(quaternion(r), expected, atol=1e-12)


def test_rotation_vector_is_differentiable_at_rest() -> None:
    w = jnp.array([0.3, -0.2, 0.5])
    slope = jax.jvp(rotation_vector, (jnp.eye(3),), (cross_matrix(w),))[1]
    np.testing.assert_allclose(slope, w, atol=1e-14)
