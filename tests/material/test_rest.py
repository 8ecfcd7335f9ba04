"""Rest, rotations and constants: what every law has in common."""

from collections.abc import Callable

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


Evaluate = Callable[[AbstractMaterial, np.ndarray], tuple[float, np.ndarray]]


def test_rest_costs_nothing_and_is_stress_free(
    law: AbstractMaterial, mu: float, energy_and_stress: Evaluate
) -> None:
    energy, stress = energy_and_stress(law, np.eye(3))
    assert abs(energy) < 1e-14 * mu
    np.testing.assert_allclose(stress, 0.0, atol=1e-13 * mu)


@settings(max_examples=40)
@given(turn=turns)
def test_rotations_cost_nothing(
    law: AbstractMaterial, mu: float, energy_and_stress: Evaluate, turn: np.ndarray
) -> None:
    energy, stress = energy_and_stress(law, turn)
    assert abs(energy) < 1e-13 * mu
    np.testing.assert_allclose(stress, 0.0, atol=2e-12 * mu)


@settings(max_examples=40)
@given(before=turns, after=turns, stretch=stretches)
def test_energy_depends_on_the_principal_stretches_alone(
    law: AbstractMaterial,
    energy_and_stress: Evaluate,
    before: np.ndarray,
    after: np.ndarray,
    stretch: np.ndarray,
) -> None:
    plain, _ = energy_and_stress(law, np.diag(stretch))
    turned, _ = energy_and_stress(law, after @ np.diag(stretch) @ before)
    assert plain >= -1e-9
    assert turned == pytest.approx(plain, rel=1e-11, abs=1e-7)


@settings(max_examples=40)
@given(turn=turns, stretch=stretches)
def test_stress_turns_with_the_body(
    law: AbstractMaterial, lame: float, energy_and_stress: Evaluate, turn: np.ndarray, stretch: np.ndarray
) -> None:
    _, principal = energy_and_stress(law, np.diag(stretch))
    _, turned = energy_and_stress(law, turn @ np.diag(stretch))
    scale = max(lame, float(np.abs(principal).max()))
    np.testing.assert_allclose(principal, np.diag(np.diag(principal)), atol=1e-11 * scale)
    np.testing.assert_allclose(turned, turn @ principal, atol=1e-11 * scale)


def test_energy_splits_into_distortion_and_dilatation(
    law: AbstractMaterial, energy_and_stress: Evaluate
) -> None:
    f = np.array([[1.2, 0.3, 0.0], [-0.1, 0.9, 0.2], [0.1, 0.0, 1.1]])
    split = law.distortion(jnp.asarray(f)) + 0.5 * law.lame * law.dilatation(jnp.asarray(f)) ** 2
    assert energy_and_stress(law, f)[0] == pytest.approx(float(split), rel=1e-13)
    assert float(law.dilatation(jnp.eye(3))) == pytest.approx(0.0, abs=1e-15)


def test_constants_are_leaves_that_can_be_fitted(law: AbstractMaterial) -> None:
    f = jnp.diag(jnp.array([1.3, 0.9, 1.0]))
    slopes = jax.tree.leaves(jax.jit(jax.grad(lambda law: law.energy(f)))(law))
    assert len(slopes) >= 2
    assert all(np.isfinite(slope).all() and np.all(slope != 0) for slope in slopes)


def test_ogden_refuses_unequal_lists() -> None:
    with pytest.raises(ConfigError, match="equally long"):
        Ogden(np.ones(2), np.ones(1), 1.0)
