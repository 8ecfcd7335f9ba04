"""The last frames of a filter that runs behind its readings.

A touch is recognised some frames late. What a filter learns from readings at rest it therefore learns from
the frame that leaves the lag: only of that it is known that it precedes any touch that the frames since may
reveal.
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

Frame = TypeVar("Frame")


def lag_of(frame: Frame, frames: int) -> Frame:
    """So many frames (n, ...) that are all alike."""
    return jax.tree.map(lambda each: jnp.broadcast_to(each, (frames, *each.shape)), frame)


def oldest(lag: Frame) -> Frame:
    """The frame that is next to leave the lag."""
    return jax.tree.map(lambda each: each[0], lag)


def pushed(lag: Frame, frame: Frame) -> Frame:
    """The lag with a new frame at its end, without the oldest."""
    return jax.tree.map(lambda old, new: jnp.concatenate([old[1:], jnp.asarray(new)[None]]), lag, frame)


def usable_mean(
    value: Float[Array, "n k"], usable: Bool[Array, "n k"]
) -> tuple[Float[Array, " k"], Int[Array, " k"]]:
    """Mean of the usable values of a lag, 0 without any, and their number."""
    count = jnp.sum(usable, axis=0)
    return jnp.sum(jnp.where(usable, value, 0.0), axis=0) / jnp.maximum(count, 1), count
