"""An array that is switched on while something touches it.

The first reading of an electrode becomes its baseline, so that what touches then is not seen, and what leaves
later leaves a hole. Where it is known what the electrodes read untouched, they can tell: of what they read
beyond that, less the median of the rows, or columns, so that all may have drifted together,

    2 min(max over rows, max over columns) > contact_on,

a strength that only contact reaches, in both directions, so that one line that has drifted is no contact.
Then the known baseline is taken, and the touch is there at once. Otherwise the first reading is taken.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensors.capacitive import ArrayState, CapacitiveArray, array_signal
from softfuse.sensors.crossed.touch import TouchDetector


def known_baseline(array: CapacitiveArray, state: ArrayState) -> ArrayState:
    """State in which every electrode has the baseline that it is known to have untouched."""
    known = jnp.broadcast_to(array.untouched_counts, state.baseline_counts.shape)
    frames = jnp.ones_like(state.baseline_frames)
    return eqx.tree_at(lambda s: (s.baseline_counts, s.baseline_frames), state, (known, frames))


def starts_touched(
    array: CapacitiveArray,
    detector: TouchDetector,
    state: ArrayState,
    row_counts: Float[Array, " r"],
    column_counts: Float[Array, " c"],
) -> Bool[Array, ""]:
    """Whether these are the first readings, and something touches.

    Args: state before this frame; row_counts (r,), column_counts (c,) [counts], NaN where missing.
    """
    counts = jnp.concatenate([row_counts, column_counts])
    reading = array_signal(array, known_baseline(array, state), counts)
    # A line that is lost, or of which nothing is known, has no say.
    says = reading.valid & jnp.isfinite(array.untouched_counts)

    def beyond(lines: slice) -> Float[Array, ""]:
        signal = reading.signal_counts[lines]
        median = jnp.nanmedian(jnp.where(says[lines], signal, jnp.nan))
        return jnp.max(jnp.where(says[lines], signal, -jnp.inf)) - median

    rows = row_counts.shape[0]
    least = jnp.minimum(beyond(slice(None, rows)), beyond(slice(rows, None)))
    return jnp.all(state.baseline_frames == 0) & (2.0 * least > detector.contact_on_counts)
