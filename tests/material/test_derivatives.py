"""First to third derivative of every law and the moduli at rest, also where principal stretches coincide."""

from functools import partial
from typing import NamedTuple

import jax
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
PAIRS = np.stack(np.meshgrid(np.arange(9), np.arange(9), indexing="ij"), -1).reshape(-1, 2)
BASIS = np.eye(9).reshape(9, 3, 3)
SINGLE = np.array([np.eye(3), ROTATIONS[2]])  # every pair of directions is tried here


class Jet(NamedTuple):
    """Derivatives of the energy, contracted with two directions a and b."""

    energy: np.ndarray
    stress: np.ndarray
    tangent_a: np.ndarray
    tangent_b: np.ndarray
    third_ab: np.ndarray


class Jets(NamedTuple):
    """At the states along random directions; by finite differences along b; in full at the SINGLE states."""

    b: np.ndarray
    exact: Jet
    slopes: Jet
    full: Jet


# Optimised code would compile for most of a minute and run for milliseconds.
@partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
@partial(jax.vmap, in_axes=(None, 0, 0, 0))
def jet(law: AbstractMaterial, state: jax.Array, a: jax.Array, b: jax.Array) -> tuple[jax.Array, ...]:
    """Forward over forward over reverse: the columns of jacfwd(hessian)."""

    def along_a(state: jax.Array) -> tuple[tuple[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]:
        return jax.jvp(jax.value_and_grad(law.energy), (state,), (a,))

    ((energy, stress), (_, tangent_a)), ((_, tangent_b), (_, third_ab)) = jax.jvp(along_a, (state,), (b,))
    return energy, stress, tangent_a, tangent_b, third_ab


@pytest.fixture(scope="module")
def jets(law: AbstractMaterial) -> Jets:
    a, b = np.random.default_rng(5).standard_normal((2, *STATES.shape))
    offsets, weights = STENCIL
    shifted = (STATES + STEP * offsets[:, None, None, None] * b).reshape(-1, 3, 3)
    states = np.concatenate([STATES, shifted, np.repeat(SINGLE, len(PAIRS), 0)])
    all_a = np.concatenate([np.tile(a, (5, 1, 1)), np.tile(BASIS[PAIRS[:, 0]], (2, 1, 1))])
    all_b = np.concatenate([np.tile(b, (5, 1, 1)), np.tile(BASIS[PAIRS[:, 1]], (2, 1, 1))])
    n, values = len(STATES), [np.asarray(v) for v in jet(law, states, all_a, all_b)]
    moved = [v[n : 5 * n].reshape(4, n, *v.shape[1:]) for v in values]
    return Jets(
        b,
        Jet(*(v[:n] for v in values)),
        Jet(*(np.tensordot(weights, v, 1) / STEP for v in moved)),
        Jet(*(v[5 * n :].reshape(2, 9, 9, *v.shape[1:]) for v in values)),
    )


def test_everything_is_finite(jets: Jets) -> None:
    assert all(np.isfinite(value).all() for value in (*jets.exact, *jets.full))


def test_stress_is_the_slope_of_the_energy(jets: Jets, mu: float) -> None:
    work = np.sum(jets.exact.stress * jets.b, axis=(1, 2))
    np.testing.assert_allclose(work, jets.slopes.energy, rtol=1e-7, atol=1e-7 * mu)


def test_tangent_is_the_slope_of_the_stress(jets: Jets, mu: float) -> None:
    np.testing.assert_allclose(jets.exact.tangent_b, jets.slopes.stress, rtol=1e-7, atol=1e-7 * mu)


def test_third_derivative_is_the_slope_of_the_tangent(jets: Jets, mu: float) -> None:
    assert np.abs(jets.exact.third_ab).max() > mu / 10
    np.testing.assert_allclose(jets.exact.third_ab, jets.slopes.tangent_a, rtol=1e-7, atol=1e-7 * mu)


def test_third_derivative_is_symmetric_at_rest_and_at_a_rotation(jets: Jets, mu: float) -> None:
    third = jets.full.third_ab.reshape(2, 9, 9, 9)
    assert np.abs(third).max() > mu / 10
    for axes in ((0, 2, 1, 3), (0, 3, 2, 1)):
        np.testing.assert_allclose(third, third.transpose(axes), atol=1e-10 * mu)


def test_tangent_at_rest_is_isotropic_linear_elasticity(
    law: AbstractMaterial, jets: Jets, mu: float, lame: float
) -> None:
    eye, tangent = np.eye(3), jets.full.tangent_a[0, :, 0].reshape(3, 3, 3, 3)
    expected = lame * np.einsum("ij,kl->ijkl", eye, eye) + mu * (
        np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    )
    np.testing.assert_allclose(tangent, expected, atol=1e-11 * lame)
    assert float(law.shear_modulus()) == pytest.approx(mu, rel=1e-14)
