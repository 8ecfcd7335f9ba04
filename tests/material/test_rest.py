"""Rest, small strains and rotations: what every law has in common."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from softfuse.errors import ConfigError
from softfuse.material import AbstractMaterial, Ogden

numbers = st.floats(-1.0, 1.0)
turns = st.tuples(numbers, numbers, numbers).map(
    lambda v: Rotation.from_rotvec(np.pi * np.array(v)).as_matrix()
)
stretches = st.tuples(*[st.floats(0.3, 3.0)] * 3).map(np.array)


@jax.jit
def energy(law: AbstractMaterial, f: jax.Array) -> jax.Array:
    return law.energy(f)


@jax.jit
def stress(law: AbstractMaterial, f: jax.Array) -> jax.Array:
    return jax.grad(law.energy)(f)


def test_rest_costs_nothing_and_is_stress_free(law: AbstractMaterial, mu: float) -> None:
    assert abs(energy(law, jnp.eye(3))) < 1e-14 * mu
    np.testing.assert_allclose(stress(law, jnp.eye(3)), 0.0, atol=1e-13 * mu)


def test_small_strains_are_isotropic_linear_elasticity(law: AbstractMaterial, mu: float, lame: float) -> None:
    eye = np.eye(3)
    expected = lame * np.einsum("ij,kl->ijkl", eye, eye) + mu * (
        np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    )
    np.testing.assert_allclose(jax.jit(jax.hessian(law.energy))(jnp.eye(3)), expected, atol=1e-11 * lame)
    assert float(law.shear_modulus()) == pytest.approx(mu, rel=1e-14)


@settings(max_examples=40, deadline=None)
@given(turn=turns)
def test_rotations_cost_nothing(law: AbstractMaterial, mu: float, turn: np.ndarray) -> None:
    assert abs(energy(law, turn)) < 1e-13 * mu
    np.testing.assert_allclose(stress(law, turn), 0.0, atol=2e-12 * mu)


@settings(max_examples=40, deadline=None)
@given(before=turns, after=turns, stretch=stretches)
def test_energy_depends_on_the_principal_stretches_alone(
    law: AbstractMaterial, before: np.ndarray, after: np.ndarray, stretch: np.ndarray
) -> None:
    plain = float(energy(law, np.diag(stretch)))
    assert float(energy(law, after @ np.diag(stretch) @ before)) == pytest.approx(plain, rel=1e-11, abs=1e-7)


@settings(max_examples=40, deadline=None)
@given(turn=turns, stretch=stretches)
def test_stress_is_the_rotated_principal_stress(
    law: AbstractMaterial, lame: float, turn: np.ndarray, stretch: np.ndarray
) -> None:
    principal = np.asarray(stress(law, np.diag(stretch)))
    np.testing.assert_allclose(principal, np.diag(np.diag(principal)), atol=1e-9 * lame)
    turned = np.asarray(stress(law, turn @ np.diag(stretch)))
    np.testing.assert_allclose(turned, turn @ principal, atol=1e-11 * max(lame, np.abs(principal).max()))


@settings(max_examples=40, deadline=None)
@given(stretch=stretches)
def test_energy_is_positive_away_from_rest(law: AbstractMaterial, stretch: np.ndarray) -> None:
    assert float(energy(law, np.diag(stretch))) >= -1e-9


def test_energy_splits_into_distortion_and_dilatation(law: AbstractMaterial) -> None:
    f = jnp.array([[1.2, 0.3, 0.0], [-0.1, 0.9, 0.2], [0.1, 0.0, 1.1]])
    split = law.distortion(f) + 0.5 * law.lame * law.dilatation(f) ** 2
    assert float(energy(law, f)) == pytest.approx(float(split), rel=1e-13)
    assert float(law.dilatation(jnp.eye(3))) == pytest.approx(0.0, abs=1e-15)


def test_constants_are_leaves_that_can_be_fitted(law: AbstractMaterial) -> None:
    f = jnp.diag(jnp.array([1.3, 0.9, 1.0]))
    slopes = jax.tree.leaves(jax.grad(lambda law: law.energy(f))(law))
    assert len(slopes) >= 2
    assert all(np.isfinite(slope).all() and np.all(slope != 0) for slope in slopes)


def test_ogden_refuses_unequal_lists() -> None:
    with pytest.raises(ConfigError, match="equally long"):
        Ogden([1.0, 2.0], [2.0], 1.0)
