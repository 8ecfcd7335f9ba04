"""Touch decision from the capacitive signals, with hysteresis and debouncing; tells proximity from contact.

The strength m = max(row signals) + max(column signals) [counts] hardly depends on where the array is touched.

* near: m above `near_on_sigma` (below `near_off_sigma`: no longer) standard deviations of the noise.
* touching: m above `contact_on_counts` for `on_frames` frames; or near while gas moves, for
  `on_frames` frames: something too small or too weakly grounded to reach that level, which nevertheless
  squeezes.
* released: m below `release_fraction` of the largest m of this touch for `off_frames` frames. A fraction,
  since the level in contact depends on the size of what touches; the signal falls by half within a third of a
  millimetre of air.
* touching again before it has gone away: m above `return_fraction` of the largest m as well.

A false early touch costs a little zero tracking; a late one costs nothing up to the lag of the zero filter
(flow).

Switched on while something touches, the first reading of an electrode would become its baseline, so that what
touches then is not seen, and what leaves later leaves a hole. Where it is known what the electrodes read
untouched, they can tell: of what they read beyond that, less the median of the rows, or columns, so that all
may have drifted together,

    2 min(max over rows, max over columns) > contact_on,

a strength that only contact reaches, in both directions, so that one line that has drifted is no contact.
Then the known baseline is taken, and the touch is there at once. Otherwise the first reading is taken.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.sensors.capacitive import ArrayState, CapacitiveArray, array_signal


class TouchDetector(eqx.Module):
    """Thresholds, see above: of the strength in standard deviations of one electrode's reading, or counts; of
    the flow from zero, which means contact while something is near, in its own; parts of the touch's largest
    strength; frames in a row. All fields are leaves.
    """

    noise_counts: Float[Array, ""]
    near_on_sigma: Float[Array, ""]
    near_off_sigma: Float[Array, ""]
    contact_on_counts: Float[Array, ""]
    flow_sigma: Float[Array, ""]
    release_fraction: Float[Array, ""]
    return_fraction: Float[Array, ""]
    on_frames: Int[Array, ""]
    off_frames: Int[Array, ""]


class TouchState(eqx.Module):
    """Memory of the decision."""

    near: Bool[Array, ""]
    touching: Bool[Array, ""]
    frames: Int[Array, ""]
    largest_counts: Float[Array, ""]


def touch_init() -> TouchState:
    """State before the first frame: nothing near."""
    no = jnp.asarray(False)
    return TouchState(near=no, touching=no, frames=jnp.zeros((), int), largest_counts=jnp.zeros(()))


def touch_begun(strength_counts: Float[Array, ""]) -> TouchState:
    """State in which something touches with a strength [counts]."""
    yes = jnp.asarray(True)
    return TouchState(near=yes, touching=yes, frames=jnp.zeros((), int), largest_counts=strength_counts)


def touch_strength(row_signal: Float[Array, " r"], column_signal: Float[Array, " c"]) -> Float[Array, ""]:
    """Strength m: row_signal (r,), column_signal (c,) [counts], invalid ones 0; returns m >= 0 [counts]."""
    return jnp.maximum(jnp.max(row_signal), 0.0) + jnp.maximum(jnp.max(column_signal), 0.0)


def touch_update(
    detector: TouchDetector,
    state: TouchState,
    strength_counts: Float[Array, ""],
    flow_deviation: Float[Array, ""],
) -> TouchState:
    """One frame.

    Args: strength_counts from touch_strength [counts]; flow_deviation: largest deviation of a channel's
    recent flow from zero [standard deviations], 0 without flow sensors.
    """
    sigma = strength_counts / detector.noise_counts
    near = jnp.where(state.near, sigma > detector.near_off_sigma, sigma > detector.near_on_sigma)
    squeezed = near & (flow_deviation > detector.flow_sigma)
    contact = jnp.maximum(detector.contact_on_counts, detector.return_fraction * state.largest_counts)
    begins = (strength_counts > contact) | squeezed
    ends = strength_counts < detector.release_fraction * state.largest_counts
    frames = jnp.where(jnp.where(state.touching, ends, begins), state.frames + 1, 0)
    flip = frames >= jnp.where(state.touching, detector.off_frames, detector.on_frames)
    touching = state.touching ^ flip
    near = near | touching
    # A spike must not raise the level at which the touch ends: the level rises by at most a tenth a frame.
    risen = jnp.clip(strength_counts, state.largest_counts, 1.1 * state.largest_counts)
    largest = jnp.where(flip & touching, strength_counts, jnp.where(touching, risen, state.largest_counts))
    return TouchState(
        near=near,
        touching=touching,
        frames=jnp.where(flip, 0, frames),
        largest_counts=jnp.where(near, largest, 0.0),
    )


def known_baseline(array: CapacitiveArray, state: ArrayState) -> ArrayState:
    """State in which every electrode has the baseline that it is known to have untouched."""
    known = jnp.broadcast_to(array.untouched_counts, state.baseline_counts.shape)
    frames = jnp.ones_like(state.baseline_frames)
    return eqx.tree_at(lambda s: (s.baseline_counts, s.baseline_frames), state, (known, frames))


def starts_touched(
    array: CapacitiveArray,
    detector: TouchDetector,
    state: ArrayState,
    counts: Float[Array, " e"],
    rows: int,
) -> Bool[Array, ""]:
    """Whether these are the first readings, and something touches.

    Args: state before this frame; counts (e,) of so many rows, then columns, NaN where missing.
    """
    reading = array_signal(array, known_baseline(array, state), counts)
    # A line that is lost, or of which nothing is known, has no say.
    says = reading.valid & jnp.isfinite(array.untouched_counts)

    def beyond(lines: slice) -> Float[Array, ""]:
        signal = reading.signal_counts[lines]
        median = jnp.nanmedian(jnp.where(says[lines], signal, jnp.nan))
        return jnp.max(jnp.where(says[lines], signal, -jnp.inf)) - median

    least = jnp.minimum(beyond(slice(None, rows)), beyond(slice(rows, None)))
    return jnp.all(state.baseline_frames == 0) & (2.0 * least > detector.contact_on_counts)
