"""Places of which it is known that they lie within a rectangle.

Along each axis a place is N(μ, σ²) by what was seen, and between a and b. With α = (a − μ)/σ, β = (b − μ)/σ,
φ and Φ of the standard normal distribution and Z = Φ(β) − Φ(α), what both say together has (N. L. Johnson,
S. Kotz, N. Balakrishnan, Continuous Univariate Distributions 1, 2nd ed., Wiley, 1994, Sec. 13.10.1)

    mean = μ + σ (φ(α) − φ(β)) / Z,
    variance = σ² [1 + (α φ(α) − β φ(β)) / Z − ((φ(α) − φ(β)) / Z)²].
"""

import jax.numpy as jnp
from jax.scipy.special import ndtr
from jaxtyping import Array, Bool, Float

_FAR = 3.0
"""Standard deviations outside beyond which a place is outside after all."""

_WIDE = 10.0
"""Widths of the box beyond which a larger standard deviation says nothing more."""


def within(
    place_m: Float[Array, "n 2"], sigma_m: Float[Array, "n 2"], box_m: Float[Array, "2 2"]
) -> tuple[Bool[Array, " n"], Float[Array, "n 2"], Float[Array, "n 2"]]:
    """Places of which it is known that they lie within a box.

    Args: place_m (n, 2), as seen; sigma_m (n, 2), standard deviations; box_m (2, 2), lowest and highest x, y
    [all m].
    Returns: (n,) whether a place is known to any degree and may lie there; mean (n, 2) and standard
    deviations (n, 2) [m], NaN where not.
    """
    known = sigma_m > 0
    # As wide as many boxes is anywhere in one.
    sigma = jnp.clip(jnp.where(known, sigma_m, 1.0), None, _WIDE * (box_m[1] - box_m[0]))
    low, high = (box_m - place_m[:, None]).transpose(1, 0, 2) / sigma
    may = jnp.all(known & (low < _FAR) & (high > -_FAR), axis=1)
    # Beyond eight standard deviations a bound says nothing: its density would only underflow.
    low, high = (
        jnp.where(may[:, None], jnp.clip(bound, -8.0, 8.0), end) for bound, end in ((low, -8.0), (high, 8.0))
    )
    total = ndtr(high) - ndtr(low)
    at_low, at_high = (jnp.exp(-0.5 * bound**2) / jnp.sqrt(2 * jnp.pi) for bound in (low, high))
    shift = (at_low - at_high) / total
    spread = jnp.sqrt(1.0 + (low * at_low - high * at_high) / total - shift**2)
    mean, deviation = place_m + sigma * shift, sigma * spread
    return may, jnp.where(may[:, None], mean, jnp.nan), jnp.where(may[:, None], deviation, jnp.nan)
