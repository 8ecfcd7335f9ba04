"""A cable through guide points in the body: its path, length and the forces that its tension puts on them.

The path runs from the fixed pulling point x_0 through the guides x_1 ... x_g; it is fastened to the last one.
Its length is ℓ = Σ_i |x_i − x_{i−1}|. A tension T in all segments pushes the guides with f_i = −T ∂ℓ/∂x_i = T
((x_{i−1} − x_i)/|x_{i−1} − x_i| + (x_{i+1} − x_i)/|x_{i+1} − x_i|), which is the direction H_c of Navarro et
al. 2020, eqs. 3 and 4, with δ_c = −ℓ. With friction (capstan, Euler and Eytelwein) the tension falls at every
guide by exp(−μ θ_i), θ_i the angle by which the cable turns there.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

_TINY = 1e-12  # keeps angles of straight cables differentiable


def segments(guides: Float[Array, "g 3"], pulled_at: Float[Array, "3"]) -> Float[Array, "g 3"]:
    """The segments x_i − x_{i−1} (g, 3) m of a cable through guides (g, 3) m pulled at a point (3,) m."""
    return guides - jnp.concatenate([pulled_at[None], guides[:-1]])


def length(guides: Float[Array, "g 3"], pulled_at: Float[Array, "3"]) -> Float[Array, ""]:
    """ℓ [m] of a cable through guides (g, 3) m pulled at a point (3,) m."""
    return jnp.sum(jnp.linalg.norm(segments(guides, pulled_at), axis=1))


def guide_forces(
    guides: Float[Array, "g 3"],
    pulled_at: Float[Array, "3"],
    tension: Float[Array, ""],
    friction: Float[Array, ""],
) -> Float[Array, "g 3"]:
    """Forces (g, 3) N on the guides of a cable pulled with `tension` [N].

    `guides` (g, 3) m; `pulled_at` (3,) m; `friction` μ [-]: positive while pulled, negative while let out.
    """
    along = segments(guides, pulled_at)
    unit = along / jnp.linalg.norm(along, axis=1, keepdims=True)
    cosine = jnp.sum(unit[1:] * unit[:-1], axis=1)
    sine = jnp.sqrt(jnp.sum(jnp.cross(unit[1:], unit[:-1]) ** 2, axis=1) + _TINY**2)
    turned = jnp.concatenate([jnp.zeros(1), jnp.cumsum(jnp.arctan2(sine, cosine))])
    pull = (tension * jnp.exp(-friction * turned))[:, None] * unit
    return jnp.concatenate([pull[1:], jnp.zeros((1, 3))]) - pull
