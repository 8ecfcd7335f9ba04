"""Every law under jit, vmap, jvp and vjp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.material import AbstractMaterial

GRADIENTS = jnp.eye(3) + 0.2 * jnp.asarray(np.random.default_rng(0).standard_normal((6, 3, 3)))
DIRECTION = jnp.asarray(np.random.default_rng(1).standard_normal((3, 3)))


def test_jit_changes_nothing_and_traces_once(law: AbstractMaterial) -> None:
    traces = []

    @jax.jit
    def energy(law: AbstractMaterial, f: jax.Array) -> jax.Array:
        traces.append(1)
        return law.energy(f)

    doubled = jax.tree.map(lambda leaf: 2 * leaf, law)
    assert float(energy(law, GRADIENTS[0])) == pytest.approx(float(law.energy(GRADIENTS[0])), rel=1e-12)
    assert float(energy(doubled, GRADIENTS[0])) != pytest.approx(float(energy(law, GRADIENTS[0])), rel=1e-3)
    assert len(traces) == 1


def test_vmap_equals_a_loop(law: AbstractMaterial) -> None:
    looped = [float(law.energy(f)) for f in GRADIENTS]
    np.testing.assert_allclose(jax.vmap(law.energy)(GRADIENTS), looped, rtol=1e-11)


def test_vmap_over_the_constants(law: AbstractMaterial) -> None:
    laws = jax.tree.map(lambda leaf: jnp.stack([leaf, 1.5 * leaf]), law)
    energies = jax.vmap(lambda law: law.energy(GRADIENTS[1]))(laws)
    expected = [
        float(jax.tree.map(lambda leaf, k=factor: k * leaf, law).energy(GRADIENTS[1]))
        for factor in (1.0, 1.5)
    ]
    np.testing.assert_allclose(energies, expected, rtol=1e-11)


def test_jvp_is_the_directional_slope(law: AbstractMaterial) -> None:
    step = 1e-3
    _, slope = jax.jvp(law.energy, (GRADIENTS[2],), (DIRECTION,))
    ahead, behind, far, back = (
        float(law.energy(GRADIENTS[2] + k * step * DIRECTION)) for k in (1, -1, 2, -2)
    )
    difference = (8 * (ahead - behind) - (far - back)) / (12 * step)
    assert float(slope) == pytest.approx(difference, rel=1e-7)


def test_vjp_and_jvp_are_adjoint(law: AbstractMaterial) -> None:
    _, slope = jax.jvp(law.energy, (GRADIENTS[3],), (DIRECTION,))
    _, pull_back = jax.vjp(law.energy, GRADIENTS[3])
    (stress,) = pull_back(1.0)
    assert float(jnp.sum(stress * DIRECTION)) == pytest.approx(float(slope), rel=1e-11)
