"""The direction in which something is greatest, found without derivatives: it may have kinks there.

From a start, the best of two rings of directions around the best so far, the rings closer with each round. A
kink is a ridge along which rings are too wide to follow: where it is known to lie in a plane, the rings are
looked at in that plane too. A function whose superlevel sets on a hemisphere are convex, as those of a
separation of convex bodies are, is brought to its greatest value; others to a local one.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_ROUNDS = 120
_SHRINKING = 0.8
_FIRST_RING = 0.3  # rad
_TURN = 2.4  # rad, the golden angle: no round looks where the last one did, so that ridges are followed
_RING: Float[np.ndarray, "r 2"] = np.concatenate(
    [
        part * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for part, angle in ((1.0, np.pi / 8 * np.arange(16)), (0.5, np.pi / 4 * (np.arange(8) + 0.5)))
    ]
)

_FLAT = 1e-9
"""Length of a projected unit direction below which it has none."""

_NOTHING = 1e-300
"""Curvature that stands for none."""

_NONE: Float[np.ndarray, "0 3"] = np.empty((0, 3))

_POLISHING = 25
"""Steps of Newton's method, halved up to as many times as there are _HALVES."""

_HALVES: Float[np.ndarray, " h"] = 0.5 ** np.arange(12)


def polished(
    value: Callable[[Float[Array, "s 3"]], Float[Array, " s"]], start: Float[Array, "3"]
) -> Float[Array, "3"]:
    """The unit direction (3,) near one (3,) in which a concave function, twice differentiable, is greatest.

    By Newton's method along the sphere's tangents, each step halved until the value grows. Nothing is
    differentiated through this; where there are no second derivatives, it stays where it is.
    """

    def better(_, best):
        (tangents,) = _tangents(best[None])

        def turned(along):
            direction = best + along @ tangents
            return direction / jnp.linalg.norm(direction)

        def at(along):
            return value(turned(along)[None])[0]

        slope, change = jax.linearize(jax.grad(at), jnp.zeros(2))
        curvature = jax.vmap(change)(jnp.eye(2))
        size = jnp.abs(jnp.trace(curvature)) + _NOTHING
        step = jnp.linalg.solve(curvature - 1e-12 * size * jnp.eye(2), -slope)
        trials = jnp.concatenate([best[None], jax.vmap(turned)(_HALVES[:, None] * step)])
        values = value(trials)
        chosen = jnp.argmax(jnp.where(jnp.isfinite(values), values, -jnp.inf))
        return trials[chosen]

    return jax.lax.stop_gradient(jax.lax.fori_loop(0, _POLISHING, better, start))


def greatest(
    value: Callable[[Float[Array, "m s 3"]], Float[Array, "m s"]],
    start: Float[Array, "m 3"],
    kinks: Float[Array | np.ndarray, "k 3"] = _NONE,
) -> Float[Array, "m 3"]:
    """Unit directions (m, 3) in which each of m functions is locally greatest, from directions (m, 3).

    `value` computes all functions, each in s directions of its own; kinks (k, 3): unit normals of planes in
    which they may have one. Nothing is differentiated through this.
    """
    normals = jax.lax.stop_gradient(jnp.asarray(kinks))
    ring = jnp.concatenate([jnp.zeros((1, 2)), jnp.asarray(_RING)])

    def closer(k, best):
        tangents = _tangents(best)
        cosine, sine = jnp.cos(_TURN * k), jnp.sin(_TURN * k)
        turned = ring @ jnp.array([[cosine, sine], [-sine, cosine]])
        around = best[:, None] + _FIRST_RING * _SHRINKING**k * jnp.einsum("sr,mri->msi", turned, tangents)
        across = jnp.einsum("msi,ki->msk", around, normals)[..., None] * normals
        within = (around[:, :, None] - across).reshape(len(best), -1, 3)
        around = jnp.concatenate([around, within], axis=1)
        # Nothing is left of a direction across the plane.
        length = jnp.linalg.norm(around, axis=-1, keepdims=True)
        around = jnp.where(length > _FLAT, around / jnp.maximum(length, _FLAT), best[:, None])
        chosen = jnp.argmax(value(around), axis=1)
        return jnp.take_along_axis(around, chosen[:, None, None], axis=1)[:, 0]

    return jax.lax.stop_gradient(jax.lax.fori_loop(0, _ROUNDS, closer, start))


def _tangents(directions: Float[Array, "m 3"]) -> Float[Array, "m 2 3"]:
    """Two unit vectors across each unit direction (m, 3), and across each other."""
    first = jnp.cross(directions, jnp.eye(3)[jnp.argmin(jnp.abs(directions), axis=1)])
    first = first / jnp.linalg.norm(first, axis=1, keepdims=True)
    return jnp.stack([first, jnp.cross(directions, first)], axis=1)
