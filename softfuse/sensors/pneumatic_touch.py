"""Touches that electrodes do not see: something that does not conduct squeezes air out of the cavities.

Such a touch begins when gas flows out of a cavity, or is squeezed in a sealed one, while nothing is near the
electrodes, for `on_frames` frames, and ends when all air is still and has come back for `off_frames`: when no
cavity lacks more than a `returned` part of the most that one has lacked, or, of one whose flow was lost,
since it was too fast to be measured, when gas flew in last. What electrodes see takes over from it. A
sensor's zero that jumps looks like an outflow without end; after `longest_s` of it the touch is given up, and
none begins until the outflow has ended.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from softfuse.sensors.base import Hint, VolumeChange


class PneumaticDetector(eqx.Module):
    """Thresholds, see above; all fields are leaves."""

    @classmethod
    def usual(cls) -> "PneumaticDetector":
        """Thresholds that suit all: nobody has needed others."""
        return cls(
            flow_sigma=jnp.asarray(8.0, float),
            returned=jnp.asarray(0.2, float),
            longest_s=jnp.asarray(20.0, float),
            on_frames=jnp.asarray(3, int),
            off_frames=jnp.asarray(3, int),
        )

    flow_sigma: Float[Array, ""]
    """Mean flow over the lag that is not still air [standard deviations]."""
    returned: Float[Array, ""]
    longest_s: Float[Array, ""]
    on_frames: Int[Array, ""]
    off_frames: Int[Array, ""]


class PneumaticState(eqx.Module):
    """Memory of the decision."""

    touching: Bool[Array, ""]
    frames: Int[Array, ""]
    outflow_s: Float[Array, ""]
    """For how long gas has flown out without a break [s]."""
    inflow: Bool[Array, ""]
    """Gas flew in last, not out."""
    largest_m3: Float[Array, ""]
    """The most air that a cavity has lacked in this touch [m^3]."""


def pneumatic_init() -> PneumaticState:
    """State before the first frame: nothing squeezes."""
    no = jnp.asarray(False)
    return PneumaticState(no, jnp.zeros((), int), jnp.zeros(()), no, jnp.zeros(()))


def pneumatic_update(
    detector: PneumaticDetector,
    state: PneumaticState,
    dt_s: Float[Array, ""],
    hint: Hint,
    volume: VolumeChange,
    near: Bool[Array, ""],
) -> PneumaticState:
    """One frame.

    Args: dt_s since the last frame [s]; hint: of gas, up to the last frame; volume: that of the last frame;
    near: whether electrodes see something in this one.
    """
    hint = hint.still(~(state.touching | hint.begins))
    flow, pressed = hint.still(hint.level), hint.still(~hint.level).squeezed() > detector.flow_sigma
    out, into = (jnp.max(each, initial=0.0) for each in (flow.outflow, -flow.outflow))
    flows = (out > into) & (out > detector.flow_sigma)
    squeezed = flows | pressed
    inflow = jnp.where(squeezed, False, state.inflow | (into > detector.flow_sigma))
    outflow_s = jnp.where(flows, state.outflow_s + dt_s, 0.0)
    endless = outflow_s > detector.longest_s
    lacking = -volume.change_m3
    largest = jnp.where(state.touching, jnp.maximum(state.largest_m3, jnp.max(lacking, initial=0.0)), 0.0)
    back = (lacking < detector.returned * largest) | (~volume.valid & inflow)
    still = (jnp.maximum(out, into) < detector.flow_sigma) & ~pressed
    wanted = jnp.where(state.touching, still & jnp.all(back), squeezed & ~endless)
    frames = jnp.where(wanted, state.frames + 1, 0)
    flip = frames >= jnp.where(state.touching, detector.off_frames, detector.on_frames)
    touching = (state.touching ^ flip) & ~near & ~endless
    return PneumaticState(touching, jnp.where(flip | near, 0, frames), outflow_s, inflow & touching, largest)
