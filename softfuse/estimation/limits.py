"""What an estimate may be: bounds of drives and of what answers them, and of how fast both may change."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Limits(NamedTuple):
    """Bounds of D drives, and how a step is damped.

    `lower`, `upper` (D,): of the drives u, equal where a drive is known; `regularisation` ε (D,) [1/drive²];
    `strokes`: lower and upper (D,) of what answers the drives (`AbstractLoad.conjugate`), equal for a hard
    equality such as a cable that is known to be 10 mm shorter, infinite for none; None where there is none at
    all; `motion` [m]: the whole step is shortened so that the drives move no node further; None for any;
    `place` [m]: standard deviation of where a contact presses around the middle of its place; None: anywhere.
    """

    lower: Float[Array, " D"]
    upper: Float[Array, " D"]
    regularisation: Float[Array, " D"]
    strokes: tuple[Float[Array, " D"], Float[Array, " D"]] | None = None
    motion: Float[Array, ""] | None = None
    place: Float[Array, ""] | None = None


class Rates(eqx.Module):
    """How fast drives (D,) and what answers them (D,) may change [unit/s]; infinite for no limit."""

    drive: Float[Array, " D"]
    stroke: Float[Array, " D"]


def within_rates(
    limits: Limits,
    rates: Rates,
    drive: Float[Array, " D"],
    stroke: Float[Array, " D"],
    dt_s: Float[Array, ""],
) -> Limits:
    """The limits narrowed to what can be reached within `dt_s` [s] of drives and strokes (D,) now.

    Where the bounds themselves cannot be reached in that time, the nearest reachable value is what is left.
    """
    lower, upper = _reachable(limits.lower, limits.upper, drive, rates.drive, dt_s)
    endless = jnp.full(stroke.shape, jnp.inf)
    low, high = (-endless, endless) if limits.strokes is None else limits.strokes
    narrowed = _reachable(low, high, stroke, rates.stroke, dt_s)
    return limits._replace(lower=lower, upper=upper, strokes=narrowed)


def _reachable(low: Array, high: Array, now: Array, rate: Array, dt_s: Array) -> tuple[Array, Array]:
    span = jnp.where(jnp.isinf(rate), jnp.inf, rate * dt_s)  # also within no time
    return jnp.clip(low, now - span, now + span), jnp.clip(high, now - span, now + span)
