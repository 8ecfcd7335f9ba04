"""Stress and moduli of arrays of points, against derivatives of energies that are written in other words.

The invariants here come from C and numpy's determinant, without softfuse's components and their derivatives.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import special_ortho_group

from softfuse.material import AbstractIsotropic, AbstractMaterial, Invariants
from softfuse.material.components import cofactor, components, contraction, cross, determinant, whole

STRETCHES = np.array(
    [
        [1.0, 1.0, 1.0],
        [1.0 + 1e-9, 1.0, 1.0 - 2e-9],
        [1.0 + 1e-5, 1.0 - 1e-5, 1.0 + 3e-5],
        [1.4, 1.4, 1.4],
        [1.5, 0.8, 0.8],
        [2.5, 0.7, 0.6],
        [0.4, 1.5, 1.5],
        [1.3, 1.1, 0.9],
    ]
)
_TURNS = special_ortho_group.rvs(3, size=2 * len(STRETCHES), random_state=8)
GRADIENTS = np.concatenate(
    [
        np.einsum("ni,ij->nij", STRETCHES, np.eye(3)),
        np.einsum("nij,nj,nkj->nik", _TURNS[: len(STRETCHES)], STRETCHES, _TURNS[len(STRETCHES) :]),
    ]
)
PRESSURES = np.linspace(-1.0, 2.0, len(GRADIENTS))  # parts of Lamé's λ


def plain_invariants(f: jax.Array) -> Invariants:
    c = f.T @ f
    return Invariants(
        jnp.trace(c), 0.5 * (jnp.trace(c) ** 2 - jnp.trace(c @ c)), jnp.dot(jnp.cross(f[0], f[1]), f[2])
    )


def plain_density(law: AbstractIsotropic, f: jax.Array, p: jax.Array) -> jax.Array:
    at = plain_invariants(f)
    return law.distortion_of(at) + p * law.dilatation_of(at) + 0.5 * law.lame * law.dilatation_of(at) ** 2


@jax.jit
def closed(law: AbstractMaterial, f: jax.Array, p: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Stresses (n, 3, 3) [Pa] and moduli (n, 3, 3, 3, 3) [Pa] of all points at once."""

    def stress(f: jax.Array) -> jax.Array:
        def total(t):
            distortion, dilatation = law.measures(t)
            return jnp.sum(distortion + p * dilatation + 0.5 * law.lame * dilatation**2)

        return whole(jax.grad(total)(components(f)))

    f = jnp.moveaxis(f, 0, -1)
    value, action = jax.linearize(stress, f)
    unit = jnp.broadcast_to(jnp.eye(9).reshape(9, 3, 3, 1), (9, *f.shape))
    return jnp.moveaxis(value, -1, 0), jnp.moveaxis(jax.vmap(action)(unit), -1, 0).reshape(-1, 3, 3, 3, 3)


@jax.jit
def differentiated(law: AbstractIsotropic, f: jax.Array, p: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The same, point by point."""
    density = partial(plain_density, law)
    return jax.vmap(jax.grad(density))(f, p), jax.vmap(jax.hessian(density))(f, p)


def test_stress_and_moduli_are_the_derivatives_of_the_energy(law: AbstractIsotropic, lame: float) -> None:
    f, p = jnp.asarray(GRADIENTS), jnp.asarray(PRESSURES * lame)
    for found, expected in zip(closed(law, f, p), differentiated(law, f, p), strict=True):
        axes = tuple(range(1, found.ndim))
        scale = np.maximum(np.abs(expected).max(axis=axes), lame)
        off = np.abs(np.asarray(found - expected)).max(axis=axes) / scale
        assert off.max() < 1e-12, off


def test_a_law_of_single_points_has_the_same_measures(law: AbstractIsotropic) -> None:
    f = jnp.moveaxis(jnp.asarray(GRADIENTS), 0, -1)
    many = law.measures(components(f))
    # What a law that is not isotropic does: point by point.
    single = AbstractMaterial.measures(law, components(f))
    for one, other in zip(many, single, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * float(law.shear_modulus()))


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_products_of_components(shape: tuple[int, ...]) -> None:
    s, t = np.random.default_rng(0).standard_normal((2, 3, 3, *shape))
    matrix = np.moveaxis(t, (0, 1), (-2, -1))
    a, b = components(jnp.asarray(s)), components(jnp.asarray(t))
    np.testing.assert_allclose(whole(a), s)
    np.testing.assert_allclose(contraction(a, b), np.sum(s * t, axis=(0, 1)), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(determinant(b), np.linalg.det(matrix), rtol=1e-12)
    cofactors = np.linalg.det(matrix)[..., None, None] * np.linalg.inv(matrix).swapaxes(-1, -2)
    np.testing.assert_allclose(
        np.moveaxis(np.asarray(whole(cofactor(b))), (0, 1), (-2, -1)), cofactors, atol=1e-11
    )
    _, along = jax.jvp(cofactor, (b,), (a,))
    np.testing.assert_allclose(whole(cross(a, b)), whole(along), rtol=1e-12, atol=1e-13)
