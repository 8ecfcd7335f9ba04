"""Every law under jit, vmap, jvp and vjp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.material import AbstractMaterial

GRADIENTS = jnp.eye(3) + 0.2 * jnp.asarray(np.random.default_rng(0).standard_normal((6, 3, 3)))
DIRECTION = jnp.asarray(np.random.default_rng(1).standard_normal((3, 3)))


def test_jit_equals_eager_and_traces_once(law: AbstractMaterial) -> None:
    traces = []

    @jax.jit
    def energy(law: AbstractMaterial, f: jax.Array) -> jax.Array:
        traces.append(1)
        return law.energy(f)

    stiffer = jax.tree.map(lambda leaf: 1.5 * leaf, law)
    assert float(energy(law, GRADIENTS[0])) == pytest.approx(float(law.energy(GRADIENTS[0])), rel=1e-12)
    assert float(energy(stiffer, GRADIENTS[0])) > 1.2 * float(energy(law, GRADIENTS[0]))
    assert len(traces) == 1


def test_vmap_over_states_and_constants_equals_loops(law: AbstractMaterial) -> None:
    laws = [jax.tree.map(lambda leaf, k=factor: k * leaf, law) for factor in (1.0, 1.2, 1.5)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *laws)
    table = jax.jit(jax.vmap(jax.vmap(lambda law, f: law.energy(f), (None, 0)), (0, None)))(
        stacked, GRADIENTS
    )
    single = jax.jit(lambda law, f: law.energy(f))
    np.testing.assert_allclose(
        table, [[float(single(one, f)) for f in GRADIENTS] for one in laws], rtol=1e-11
    )


def test_jvp_is_the_directional_slope(law: AbstractMaterial) -> None:
    step, f = 1e-3, GRADIENTS[2]
    along = jax.jit(lambda law, f: jax.jvp(law.energy, (f,), (DIRECTION,)))
    ahead, behind, far, back = (float(along(law, f + k * step * DIRECTION)[0]) for k in (1, -1, 2, -2))
    difference = (8 * (ahead - behind) - (far - back)) / (12 * step)
    assert float(along(law, f)[1]) == pytest.approx(difference, rel=1e-7)


def test_vjp_and_jvp_are_adjoint(law: AbstractMaterial) -> None:
    @jax.jit
    def both(law: AbstractMaterial, f: jax.Array) -> tuple[jax.Array, jax.Array]:
        _, slope = jax.jvp(law.energy, (f,), (DIRECTION,))
        energy, pull_back = jax.vjp(law.energy, f)
        (stress,) = pull_back(jnp.ones_like(energy))
        return slope, jnp.sum(stress * DIRECTION)

    slope, work = both(law, GRADIENTS[3])
    assert float(work) == pytest.approx(float(slope), rel=1e-11)
