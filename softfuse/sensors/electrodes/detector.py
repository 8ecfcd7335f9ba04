"""Contact detection on n single-ended electrodes that each cover a patch of skin of their own.

    signal s = counts - baseline [counts], positive when something grounded comes near;
    touched: s > on for `on_frames` frames, until s < off for `off_frames` frames.

Baseline and broken readings are those of an array (capacitive.py), decided for each electrode alone: followed
while nothing is near, frozen while touched, creeping while something is near. A frame without a usable
reading is no evidence: it neither begins nor ends a touch.

An electrode is lost, and not believed, when it is
* stuck: the same counts in `stuck_frames` frames, or at the converter's end for `lost_s`;
* stuck: its noise has vanished, that is the mean square difference between readings, 2 noise² in a live one,
  has fallen below quiet_fraction² of that (a dead amplifier still toggles between two codes);
* stuck: touched for longer than `longest_touch_s`. Its baseline then creeps: what stays on it (a drop of
  water, a drift) is calibrated away in a few creep times and the electrode believed again; when it leaves,
  the baseline recovers at once from the negative signal;
* missing for `lost_s`.
What the amplitude says about the force is left to the estimator: it is hardly anything.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.sensors.capacitive import (
    ArrayState,
    CapacitiveArray,
    array_init,
    array_signal,
    count_equal_frames,
    track_baseline,
)
from softfuse.sensors.slots import ContactSlots, assign_slots, slots_init

# A touch is a step between two readings: differences beyond this many standard deviations are no noise.
LARGEST_DIFFERENCE_SIGMA = 3.0


class ElectrodeDetector(eqx.Module):
    """Thresholds of n electrodes; all fields are leaves."""

    array: CapacitiveArray
    """Noise, limits and baseline of the electronics."""
    on_counts: Float[Array, " n"]
    """(n,) signal at which a touch begins [counts]."""
    off_counts: Float[Array, " n"]
    """(n,) signal at which it ends [counts]."""
    near_sigma: Float[Array, ""]
    """Signal at which something is near [standard deviations of one reading]."""
    on_frames: Int[Array, ""]
    """Number of frames in a row that begin a touch."""
    off_frames: Int[Array, ""]
    """Number of frames in a row that end a touch."""
    longest_touch_s: Float[Array, ""]
    """Duration of a touch that is no longer believed [s]."""
    lost_s: Float[Array, ""]
    """Time without a usable reading after which an electrode is lost [s]."""
    quiet_fraction: Float[Array, ""]
    """Fraction of the noise below which the noise has vanished; 0 where the counts do not resolve it."""
    quiet_s: Float[Array, ""]
    """Time constant over which the noise is measured [s]."""


class ElectrodeState(eqx.Module):
    """Memory of the electrodes."""

    array: ArrayState
    touched: Bool[Array, " n"]
    frames: Int[Array, " n"]
    touched_s: Float[Array, " n"]
    unusable_s: Float[Array, " n"]
    square_counts2: Float[Array, " n"]
    slots: ContactSlots


class ElectrodeReading(eqx.Module):
    """What the electrodes say about one frame."""

    signal_counts: Float[Array, " n"]
    """(n,) counts above the baseline, 0 without a usable reading."""
    near: Bool[Array, " n"]
    """(n,) something is near or touches; also while it is not believed to touch."""
    touched: Bool[Array, " n"]
    """(n,) something touches; never a lost electrode."""
    missing: Bool[Array, " n"]
    """(n,) no reading in this frame."""
    stuck: Bool[Array, " n"]
    """(n,) dead, at the converter's end, or touched for too long."""
    lost: Bool[Array, " n"]
    """(n,) stuck, or missing for too long: says nothing about contact."""
    slots: ContactSlots
    """The touched electrodes that are followed."""


def electrode_init(detector: ElectrodeDetector, slots: int) -> ElectrodeState:
    """State before the first frame, untouched; `slots` contacts are followed at once.

    Raises ConfigError unless there are between 1 and n slots.
    """
    n = detector.on_counts.shape[0]
    return ElectrodeState(
        array=array_init(n),
        touched=jnp.zeros(n, bool),
        frames=jnp.zeros(n, int),
        touched_s=jnp.zeros(n),
        unusable_s=jnp.zeros(n),
        square_counts2=jnp.zeros(n) + 2.0 * detector.array.noise_counts**2,
        slots=slots_init(slots, n),
    )


def _mean_square_difference(
    detector: ElectrodeDetector, state: ElectrodeState, dt_s: Float[Array, ""], counts: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Mean square difference between readings (n,) [counts^2]; a missing one changes nothing."""
    difference = counts - state.array.last_counts
    known = jnp.isfinite(difference)
    largest = 2.0 * (LARGEST_DIFFERENCE_SIGMA * detector.array.noise_counts) ** 2
    square = jnp.minimum(jnp.where(known, difference, 0.0) ** 2, largest)
    weight = jnp.where(known, 1.0 - jnp.exp(-dt_s / detector.quiet_s), 0.0)
    return state.square_counts2 + weight * (square - state.square_counts2)


def electrode_update(
    detector: ElectrodeDetector, state: ElectrodeState, dt_s: Float[Array, ""], counts: Float[Array, " n"]
) -> tuple[ElectrodeState, ElectrodeReading]:
    """One frame.

    Args: dt_s time since the last frame [s], 0 for the first; counts (n,) readings, NaN where missing.
    Returns: the new state and the ElectrodeReading.
    """
    array = detector.array
    signal = array_signal(array, state.array, counts)
    square = _mean_square_difference(detector, state, dt_s, counts)
    quiet = square < detector.quiet_fraction**2 * 2.0 * array.noise_counts**2

    begins = signal.signal_counts > detector.on_counts
    ends = signal.signal_counts < detector.off_counts
    counted = state.frames + (signal.valid & jnp.where(state.touched, ends, begins))
    frames = jnp.where(signal.valid & (counted == state.frames), 0, counted)
    flip = frames >= jnp.where(state.touched, detector.off_frames, detector.on_frames)
    touched = state.touched ^ flip
    touched_s = jnp.where(touched, state.touched_s + dt_s, 0.0)
    overlong = touched_s > detector.longest_touch_s

    missing = ~jnp.isfinite(counts)
    at_end = (counts <= array.lowest_counts) | (counts >= array.highest_counts)
    unusable_s = jnp.where(signal.valid, 0.0, state.unusable_s + dt_s)
    gone = unusable_s > detector.lost_s
    dead = quiet | (count_equal_frames(state.array, counts) >= array.stuck_frames)
    stuck = dead | overlong | (gone & at_end)
    lost = stuck | gone

    # A touch that lasts too long is remembered, to know when it ends; that of a dead electrode is forgotten.
    remembered = touched & ~dead & ~gone
    believed = remembered & ~overlong
    near = signal.valid & (signal.signal_counts > detector.near_sigma * array.noise_counts)
    slots = assign_slots(state.slots, signal.signal_counts, believed)
    later = ElectrodeState(
        array=track_baseline(array, state.array, dt_s, counts, near | remembered, believed),
        touched=remembered,
        frames=jnp.where(flip | dead | gone, 0, frames),
        touched_s=jnp.where(remembered, touched_s, 0.0),
        unusable_s=unusable_s,
        square_counts2=square,
        slots=slots,
    )
    return later, ElectrodeReading(
        signal_counts=signal.signal_counts,
        near=near | believed,
        touched=believed,
        missing=missing,
        stuck=stuck,
        lost=lost,
        slots=slots,
    )
