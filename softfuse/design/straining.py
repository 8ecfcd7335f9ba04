"""How much a body is strained: the largest stretch of a state, and the largest strain of a small motion.

Eigenvalues of symmetric tensors are found by the cosines of their characteristic polynomial's roots: with
m = tr b/3, a = b − m I and s² = a : a/6, the largest is m + 2 s cos φ, cos 3φ = det a/(2 s³). Source: O. K.
Smith, Comm. ACM 4(4), 1961.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.body import Body

_NOTHING = 1e-12
"""Strain that is none."""


def largest_stretch(body: Body, z: Float[Array, " n"]) -> Float[Array, ""]:
    """The largest length over that at rest [-] at a quadrature point of a body with unknowns z (n,): √ of the
    largest eigenvalue of F Fᵀ.
    """
    f = _deformations(body, z)
    return jnp.sqrt(jnp.max(_largest_eigenvalue(jnp.einsum("ijm,kjm->ikm", f, f))))


def largest_strain(body: Body, motion: Float[Array, "k 3"]) -> Float[Array, ""]:
    """The largest principal strain [per unit of what `motion` (k, 3) m of all nodes is for] at a quadrature
    point, ½ (∇v + ∇vᵀ); differentiable once in both.
    """
    z = jnp.zeros(body.n).at[body.displacement_index].set(motion, mode="drop")
    slope = _deformations(body, z) - jnp.eye(3)[:, :, None]
    strain = 0.5 * (slope + jnp.swapaxes(slope, 0, 1))
    # Where there is no strain the roots have no derivatives, which would spoil those of the worst point.
    worst = jnp.argmax(_largest_eigenvalue(jax.lax.stop_gradient(strain)))
    return _largest_eigenvalue(strain[:, :, worst, None])[0]


def _deformations(body: Body, z: Float[Array, " n"]) -> Float[Array, "3 3 m"]:
    """F at all quadrature points."""
    padded = jnp.append(z, 0.0)
    regions = body.regions()
    parts = [jnp.array(region.deformation(region.strains(padded)[0])) for region in regions]
    return jnp.concatenate([part.reshape(3, 3, -1) for part in parts], axis=2)


def _largest_eigenvalue(b: Float[Array, "3 3 m"]) -> Float[Array, " m"]:
    # Not by LAPACK, whose own threads and ours would wait for each other.
    mean = jnp.trace(b) / 3.0
    away = b - mean * jnp.eye(3)[:, :, None]
    size = jnp.sqrt(jnp.sum(away**2, axis=(0, 1)) / 6.0)
    determinant = jnp.sum(jnp.cross(away[0], away[1], axis=0) * away[2], axis=0)
    cosine = determinant / (2.0 * jnp.maximum(size, _NOTHING) ** 3)
    return mean + 2.0 * size * jnp.cos(jnp.arccos(jnp.clip(cosine, -1.0, 1.0)) / 3.0)
