"""A body's centreline as a chain of material points, and how it is bent.

The chain's links x_{i+1} − x_i stand for the segments between the points. A link's turn is the angle between
it and the link before, minus that angle at rest; the first link is compared with its own direction at rest,
which the clamp holds. Curvature is turn over rest length.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

_TINY = 1e-15  # keeps the angle of links in line differentiable


class Bending(eqx.Module):
    """Turns (l,) [rad] of the links, between 0 and π, and curvatures (l,) [1/m]."""

    turn: Float[Array, " l"]
    curvature: Float[Array, " l"]


def bending(points: Float[Array, "p 3"], rest: Float[Array, "p 3"]) -> Bending:
    """How the chain of points (p, 3) m is bent against its shape at `rest` (p, 3) m; l = p − 1 links."""
    links, before = jnp.diff(points, axis=0), jnp.diff(rest, axis=0)
    length = jnp.linalg.norm(before, axis=1)
    # The clamp holds the direction in which the first link starts.
    now = _angles(jnp.concatenate([before[:1], links]))
    then = _angles(jnp.concatenate([before[:1], before]))
    turn = now - then
    return Bending(turn, turn / length)


def tip_turn(points: Float[Array, "p 3"], rest: Float[Array, "p 3"]) -> Float[Array, ""]:
    """Angle [rad], 0 to π, of a chain's last link, points (p, 3) m, with its direction at `rest` (p, 3) m."""
    return _angles(jnp.stack([rest[-1] - rest[-2], points[-1] - points[-2]]))[0]


def _angles(links: Float[Array, "m 3"]) -> Float[Array, " n"]:
    """Angles (m − 1,) [rad] between successive links (m, 3)."""
    unit = links / jnp.linalg.norm(links, axis=1, keepdims=True)
    sine = jnp.sqrt(jnp.sum(jnp.cross(unit[1:], unit[:-1]) ** 2, axis=1) + _TINY**2)
    return jnp.arctan2(sine, jnp.sum(unit[1:] * unit[:-1], axis=1))
