"""The time of a frame: sensors integrate and average over steps forward, whatever clocks do."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def frame_step(
    last_s: Float[Array, ""], time_s: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""], Bool[Array, ""]]:
    """Time of a frame [s], the step to it [s], and whether it is later than the last one.

    Args: last_s, time of the last good frame [s], −∞ before the first; time_s, what the frame says [s].
    Where time is missing or does not increase it stands still; the first frame has no step.
    """
    started = jnp.isfinite(last_s)
    forward = jnp.isfinite(time_s) & (time_s > last_s)
    now = jnp.where(forward, time_s, last_s)
    # Inside as well: a difference to −∞ has no derivative.
    step = jnp.where(started & forward, now - jnp.where(started, last_s, now), 0.0)
    return now, step, forward
