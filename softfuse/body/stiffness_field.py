"""A smooth field of stiffness over a body: one that was cast is a few percent stiffer where it was mixed,
filled or cured otherwise.

All moduli at a rest position X are times f(X),

    ln f = Σ_k c_k b_k(ξ),

with ξ from −1 to 1 along each axis of the body's bounding box, and the products b_k of Legendre polynomials
up to total degree 2 but for the constant: ξ, products of two, and P₂ = (3 ξ² − 1)/2. Over a full box all have
the mean 0, so that the field leaves the mean of ln f to the materials. It is taken in the middle of each
element.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.body import Body

TERMS = ("x", "y", "z", "xy", "xz", "yz", "xx", "yy", "zz")
"""Names of the b_k in their order; a letter twice is P₂ of its axis."""


def with_field(body: Body, coefficients: Float[Array, "9"]) -> Body:
    """The body with factors of a field of coefficients c (9,) [-], in the order of `TERMS`; differentiable in
    these and in the rest nodes.
    """
    return body.with_factors(jnp.exp(coefficients @ field_terms(body)))


def field_terms(body: Body) -> Float[Array, "9 e"]:
    """The b_k (9, e) in the middles of a body's elements."""
    low, high = jnp.min(body.rest, axis=0), jnp.max(body.rest, axis=0)
    middles = jnp.mean(body.rest[body.tets[:, :4]], axis=1)
    x, y, z = ((2 * middles - low - high) / (high - low)).T
    curved = (1.5 * jnp.square(each) - 0.5 for each in (x, y, z))
    return jnp.stack([x, y, z, x * y, x * z, y * z, *curved])
