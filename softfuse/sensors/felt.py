"""Touches that electrodes do not see: something that does not conduct squeezes air out of the cavities.

Such a touch begins when gas flows out of a cavity while nothing is near the electrodes, for `on_frames`
frames, and ends when all air is still and has come back: when no cavity lacks more than a `returned` part of
the most that one has lacked, or, of one whose flow was lost, since it was too fast to be measured, when gas
flew in last. What electrodes see takes over from it. A sensor's zero that jumps looks like an outflow without
end; after `longest_s` of it the touch is given up, and none begins until the outflow has ended.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class FeltDetector(eqx.Module):
    """Thresholds; all fields are leaves."""

    flow_sigma: Float[Array, ""]
    """Mean flow over the lag that is not still air [standard deviations]."""
    returned: Float[Array, ""]
    """Part of the largest lack of air at which the touch has ended [-]."""
    longest_s: Float[Array, ""]
    """Time of outflow without a break after which it is a zero that has jumped [s]."""
    on_frames: Int[Array, ""]
    """Number of frames in a row that begin a touch."""
    off_frames: Int[Array, ""]
    """Number of frames in a row that end a touch."""


class VolumeChange(eqx.Module):
    """Changes of volume (k,) [m^3] and whether no flow was lost (k,)."""

    change_m3: Float[Array, " k"]
    valid: Bool[Array, " k"]


class FeltState(eqx.Module):
    """Memory of the decision."""

    felt: Bool[Array, ""]
    frames: Int[Array, ""]
    outflow_s: Float[Array, ""]
    """For how long gas has flown out without a break [s]."""
    inflow: Bool[Array, ""]
    """Gas flew in last, not out."""
    largest_m3: Float[Array, ""]
    """The most air that a cavity has lacked in this touch [m^3]."""


def felt_detector(
    *,
    flow_sigma: float = 8.0,
    returned: float = 0.2,
    longest_s: float = 20.0,
    on_frames: int = 3,
    off_frames: int = 3,
) -> FeltDetector:
    """Thresholds; the options are the fields of FeltDetector."""
    return FeltDetector(
        flow_sigma=jnp.asarray(flow_sigma, float),
        returned=jnp.asarray(returned, float),
        longest_s=jnp.asarray(longest_s, float),
        on_frames=jnp.asarray(on_frames, int),
        off_frames=jnp.asarray(off_frames, int),
    )


def felt_init() -> FeltState:
    """State before the first frame: nothing squeezes."""
    no = jnp.asarray(False)
    return FeltState(no, jnp.zeros((), int), jnp.zeros(()), no, jnp.zeros(()))


def felt_update(
    detector: FeltDetector,
    state: FeltState,
    dt_s: Float[Array, ""],
    flow_sigma: Float[Array, " k"],
    volume: VolumeChange,
    near: Bool[Array, ""],
) -> FeltState:
    """One frame.

    Args: dt_s since the last frame [s]; flow_sigma (k,): `mean_flow` up to the last frame, 0 where it may not
    begin a touch [standard deviations]; volume: that of the last frame; near: whether electrodes see
    something in this one.
    """
    out, into = jnp.max(flow_sigma), jnp.max(-flow_sigma)
    squeezed = (out > into) & (out > detector.flow_sigma)
    inflow = jnp.where(squeezed, False, state.inflow | (into > detector.flow_sigma))
    outflow_s = jnp.where(squeezed, state.outflow_s + dt_s, 0.0)
    endless = outflow_s > detector.longest_s
    lacking = -volume.change_m3
    largest = jnp.where(state.felt, jnp.maximum(state.largest_m3, jnp.max(lacking)), 0.0)
    back = (lacking < detector.returned * largest) | (~volume.valid & inflow)
    still = jnp.maximum(out, into) < detector.flow_sigma
    wanted = jnp.where(state.felt, still & jnp.all(back), squeezed & ~endless)
    frames = jnp.where(wanted, state.frames + 1, 0)
    flip = frames >= jnp.where(state.felt, detector.off_frames, detector.on_frames)
    felt = (state.felt ^ flip) & ~near & ~endless
    return FeltState(felt, jnp.where(flip | near, 0, frames), outflow_s, inflow & felt, largest)
