"""The time of a frame: sensors integrate and average over steps forward, whatever clocks do.

A frame counts when its time is later than that of the last one that did, but not far ahead: by no more than
ten usual steps or half a second. A frame that does not count is doubted. When `AGREEING` doubted frames in a
row are each later than the one before, the clock is taken anew, as it is after a counter wrapped, a board was
reset or a recording paused: the step to the last of them is the whole gap where the clock went ahead, and
where it went back the steps among them and the usual one, the least that can have passed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

AGREEING = 3
"""Doubted frames in a row that agree, from which on the clock is believed."""
_FAR_STEPS = 10.0
_FAR_S = 0.5
_ENDLESS_S = 1e100
"""No time is as large as this: steps between the largest numbers are infinite."""


class FrameClock(NamedTuple):
    """Memory of the time between frames."""

    time_s: Float[Array, ""]
    """Of the last frame that counts [s], −∞ before the first."""
    usual_s: Float[Array, ""]
    """Its step [s], ∞ before the second."""
    doubted_s: Float[Array, ""]
    """Of the last frame since then that does not count [s], −∞ without one."""
    since_s: Float[Array, ""]
    """Of the first of those that agree with it [s]."""
    agreeing: Int[Array, ""]
    """How many do."""


class FrameTime(NamedTuple):
    """What a frame's time says."""

    now_s: Float[Array, ""]
    """Its time, that of the last good one where it does not count [s]."""
    dt_s: Float[Array, ""]
    """The step to it [s], 0 for the first and where it does not count."""
    forward: Bool[Array, ""]
    """It counts."""
    anew: Bool[Array, ""]
    """The clock has been taken anew with it."""
    first: Bool[Array, ""]
    """No frame has counted before."""


def clock_init() -> FrameClock:
    """Before the first frame."""
    never = jnp.full((), -jnp.inf, float)
    return FrameClock(never, -never, never, never, jnp.zeros((), int))


def frame_step(clock: FrameClock, time_s: Float[Array, ""]) -> tuple[FrameClock, FrameTime]:
    """The clock after a frame that says `time_s` [s], and what that is worth."""
    started = jnp.isfinite(clock.time_s)
    known = jnp.abs(time_s) < _ENDLESS_S
    # Inside as well: a difference to −∞ has no derivative.
    ahead = time_s - jnp.where(started, clock.time_s, time_s)
    far = jnp.maximum(_FAR_STEPS * clock.usual_s, _FAR_S)
    good = known & (time_s > clock.time_s) & (~started | (ahead <= far))
    later = time_s > clock.doubted_s
    follows = later & (clock.agreeing > 0)
    agreeing = jnp.where(follows, clock.agreeing + 1, 1)
    anew = known & ~good & started & (agreeing >= AGREEING)
    since = jnp.where(follows, clock.since_s, time_s)
    forward = good | anew
    usual = jnp.where(jnp.isfinite(clock.usual_s), clock.usual_s, 0.0)
    passed = jnp.where(time_s > clock.time_s, ahead, time_s - since + usual)
    step = jnp.where(started & forward, jnp.where(good, ahead, passed), 0.0)
    last = time_s - jnp.where(anew, clock.doubted_s, 0.0)
    usual = jnp.where(anew, last, jnp.where(started & good, ahead, clock.usual_s))
    now = jnp.where(forward, time_s, clock.time_s)
    never = jnp.full_like(clock.time_s, -jnp.inf)
    doubted = known & ~forward
    return FrameClock(
        now,
        usual,
        jnp.where(forward, never, jnp.where(doubted, time_s, clock.doubted_s)),
        jnp.where(forward, never, jnp.where(doubted, since, clock.since_s)),
        jnp.where(forward, 0, jnp.where(doubted, agreeing, clock.agreeing)),
    ), FrameTime(now, step, forward, anew, ~started)


class ClockOf(NamedTuple):
    """What the times of n frames are worth: (n,) whether they count, and where the clock was taken anew."""

    counts: Bool[np.ndarray, " n"]
    anew: Bool[np.ndarray, " n"]


def clock_of(time_s: Float[np.ndarray, " n"]) -> ClockOf:
    """The same of the times (n,) [s] of all frames, whose steps are mostly good."""
    steps = np.diff(time_s)
    # Without a step that could be doubted nothing has to be gone through.
    if np.isfinite(time_s).all() and np.all((steps > 0) & (steps <= _FAR_S)):
        return ClockOf(np.ones(len(time_s), bool), np.zeros(len(time_s), bool))
    origin = time_s[np.isfinite(time_s)][:1].sum()
    _, found = jax.lax.scan(frame_step, clock_init(), jnp.asarray(time_s - origin))
    return ClockOf(np.asarray(found.forward), np.asarray(found.anew))
