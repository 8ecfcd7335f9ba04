"""All sensors of the pad: one frame of volts and counts to volume changes, touch and location.

Order of work: signals above the baseline -> touch decision (which also looks at the flow up to the last
frame: what electrodes do not see can still squeeze, `felt`) -> flow to volume with the zero tracked or frozen
by that decision -> location by the peak fit, that is followed from frame to frame while something is near ->
baseline for the next frame. Causal and pure: `pad_sensor_update` runs live, and in a `jax.lax.scan` over a
recording. An electrode that lies is found 17 frames later, see `peak_follow`. Sign: a squeezed cavity has a
negative volume change. Electrodes are ordered rows first, then columns.
"""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensing.capacitive import (
    ArrayState,
    CapacitiveArray,
    array_init,
    array_signal,
    electrode_image,
    track_baseline,
    weighted_mean_location,
)
from softfuse.sensing.felt import (
    FeltDetector,
    FeltState,
    VolumeChange,
    felt_detector,
    felt_init,
    felt_update,
)
from softfuse.sensing.flow import (
    FlowSensor,
    FlowState,
    flow_evidence,
    flow_init,
    flow_unknown,
    flow_update,
    mean_flow,
)
from softfuse.sensing.frame_time import FrameClock, clock_init, frame_step
from softfuse.sensing.peak_follow import PeakTrack, follow_peak, no_peak
from softfuse.sensing.peak_model import PeakModel
from softfuse.sensing.reading_drift import ReadingDrift
from softfuse.sensing.touch import (
    TouchDetector,
    TouchState,
    touch_begun,
    touch_init,
    touch_strength,
    touch_update,
)
from softfuse.sensing.touched_start import known_baseline, starts_touched

_S = TypeVar("_S")


class PadSensors(eqx.Module):
    """Parameters of the flow sensors, the array, the peak model and the touch decision."""

    flow: FlowSensor
    array: CapacitiveArray
    peak: PeakModel
    touch: TouchDetector
    felt: FeltDetector = eqx.field(default_factory=felt_detector)


class PadSensorState(eqx.Module):
    """Memory between frames."""

    clock: FrameClock
    flow: FlowState
    array: ArrayState
    volume: VolumeChange
    touch: TouchState
    felt: FeltState
    peak: PeakTrack
    lying: Bool[Array, " e"]


class PadMeasurement(eqx.Module):
    """What the sensors say about one frame."""

    time_s: Float[Array, ""]
    """Time of the frame, that of the last good one where it does not count [s]."""
    time_valid: Bool[Array, ""]
    """The frame's time counts."""
    clock_anew: Bool[Array, ""]
    """The clock has been taken anew with it."""
    volume_change_m3: Float[Array, " k"]
    """(k,) volume change of the cavities since the last reset [m^3]."""
    volume_sigma_m3: Float[Array, " k"]
    """(k,) its standard deviation [m^3]."""
    volume_valid: Bool[Array, " k"]
    """(k,) no flow was lost since the reset."""
    flow_saturated: Bool[Array, " k"]
    """(k,) the flow sensor was clipped since the reset."""
    flow_missing: Bool[Array, " k"]
    """(k,) no reading in this frame."""
    flow_m3_s: Float[Array, " k"]
    """(k,) flow out of the cavities [m^3/s]."""
    drift: ReadingDrift
    """What the volume change drifts by."""
    near: Bool[Array, ""]
    """Something is near or touches."""
    touching: Bool[Array, ""]
    """Something touches."""
    felt: Bool[Array, ""]
    """Something touches that the electrodes do not see."""
    location_m: Float[Array, "2"]
    """(2,) x, y of the contact [m]; the array's middle while nothing is near."""
    location_covariance_m2: Float[Array, "2 2"]
    """(2, 2) its covariance [m^2]; as wide as the array while nothing is near."""
    location_widening: Float[Array, ""]
    """By how much, at least 1, the peak's misfit makes that larger [-]."""
    location_valid: Bool[Array, ""]
    """The fit ended on the array (at most half a pitch beyond the outermost lines) and is certain enough."""
    weighted_mean_m: Float[Array, "2"]
    """(2,) the paper's location [m], biased at the border; the array's middle without any signal."""
    location_residual_counts: Float[Array, ""]
    """Root mean square residual of the peak fit [counts]; 0 while nothing is near."""
    signal_counts: Float[Array, " e"]
    """(r + c,) counts above the baseline over the gain, rows first."""
    electrode_valid: Bool[Array, " e"]
    """(r + c,) electrodes that took part."""
    image: Float[Array, "c r"]
    """(c, r) image s_col (x) s_row, first index along x [counts^2]."""

    def dent_m(self, radius_m: Float[Array, ""]) -> Float[Array, ""]:
        """Depth [m] of a dent of that radius [m] that holds the volume squeezed out of the cavities; of one
        whose flow was lost as much as of that which tells most.
        """
        told = jnp.where(self.volume_valid, -self.volume_change_m3, 0.0)
        lost = jnp.sum(~self.volume_valid, axis=-1) * jnp.max(told, axis=-1)
        return jnp.maximum(jnp.sum(told, axis=-1) + lost, 0.0) / (jnp.pi * radius_m**2)


def pad_sensor_init(sensors: PadSensors) -> PadSensorState:
    """State before the first frame; the pad is taken to be untouched, unless `touched_start` tells."""
    electrodes = sensors.peak.row_y_m.shape[0] + sensors.peak.column_x_m.shape[0]
    cavities = sensors.flow.zero_V.shape[0]
    return PadSensorState(
        clock=clock_init(),
        flow=flow_init(sensors.flow),
        array=array_init(electrodes),
        volume=VolumeChange(jnp.zeros(cavities), jnp.zeros(cavities, bool)),
        touch=touch_init(),
        felt=felt_init(),
        peak=no_peak(sensors.peak),
        lying=jnp.zeros(electrodes, bool),
    )


def pad_sensor_update(
    sensors: PadSensors,
    state: PadSensorState,
    time_s: Float[Array, ""],
    flow_V: Float[Array, " k"],
    row_counts: Float[Array, " r"],
    column_counts: Float[Array, " c"],
) -> tuple[PadSensorState, PadMeasurement]:
    """One frame.

    Args: time_s [s]; flow_V (k,) [V]; row_counts (r,), column_counts (c,) [counts]; NaN where missing.
    Returns: the new state and the PadMeasurement.
    """
    clock, time = frame_step(state.clock, time_s)
    dt = time.dt_s
    counts = jnp.concatenate([row_counts, column_counts])
    started = starts_touched(sensors.array, sensors.touch, state.array, row_counts, column_counts)

    def if_started(one: _S, other: _S) -> _S:
        return jax.tree.map(lambda a, b: jnp.where(started, a, b), one, other)

    known = if_started(known_baseline(sensors.array, state.array), state.array)
    reading = array_signal(sensors.array, known, counts)
    rows = row_counts.shape[0]
    row_signal, column_signal = reading.signal_counts[:rows], reading.signal_counts[rows:]
    strength = touch_strength(row_signal, column_signal)
    evidence = flow_evidence(sensors.flow, state.flow)
    touch = touch_update(sensors.touch, state.touch, strength, evidence)
    touch = if_started(touch_begun(strength), touch)
    settled = state.felt.felt | (state.flow.released_s > sensors.flow.hold_off_s)
    flowing = jnp.where(settled, mean_flow(sensors.flow, state.flow), 0.0)
    felt = felt_update(sensors.felt, state.felt, dt, flowing, state.volume, touch.near)
    touching = touch.touching | felt.felt
    # What was squeezed out before the first frame is not known.
    flowed = if_started(flow_unknown(sensors.flow, state.flow), state.flow)
    flow_state, flow = flow_update(sensors.flow, flowed, dt, flow_V, touching)
    # An electrode found lying stays out until nothing is near.
    trusted = reading.valid & ~state.lying
    peak, (location, covariance, widening, residual, honest, located) = _locate(
        sensors.peak, state.peak, reading.signal_counts, trusted, touch.near
    )
    lying = touch.near & (state.lying | (trusted & ~honest))
    array = track_baseline(sensors.array, known, dt, counts, touch.near, touching)
    later = PadSensorState(
        clock=clock,
        flow=flow_state,
        array=array,
        volume=VolumeChange(flow.volume_change_m3, flow.volume_valid),
        touch=touch,
        felt=felt,
        peak=peak,
        lying=lying,
    )
    return later, PadMeasurement(
        time_s=time.now_s,
        time_valid=time.forward,
        clock_anew=time.anew,
        volume_change_m3=flow.volume_change_m3,
        volume_sigma_m3=flow.volume_sigma_m3,
        volume_valid=flow.volume_valid,
        flow_saturated=flow.saturated,
        flow_missing=flow.missing,
        flow_m3_s=flow.flow_m3_s,
        drift=flow.drift,
        near=touch.near,
        touching=touching,
        felt=felt.felt,
        location_m=location,
        location_covariance_m2=covariance,
        location_widening=widening,
        location_valid=located,
        weighted_mean_m=weighted_mean_location(
            sensors.peak.row_y_m, sensors.peak.column_x_m, reading.signal_counts, honest
        ),
        location_residual_counts=residual,
        signal_counts=reading.signal_counts,
        electrode_valid=honest,
        image=electrode_image(row_signal, column_signal),
    )


def _locate(
    peak: PeakModel,
    track: PeakTrack,
    signal: Float[Array, " e"],
    valid: Bool[Array, " e"],
    near: Bool[Array, ""],
):
    """The track, and location, covariance, its widening, residual, honest electrodes, whether to believe;
    no fit while nothing is near.
    """
    low = jnp.stack([peak.column_x_m[0], peak.row_y_m[0]])
    high = jnp.stack([peak.column_x_m[-1], peak.row_y_m[-1]])
    lines = jnp.asarray([peak.column_x_m.shape[0], peak.row_y_m.shape[0]])
    half_pitch = 0.5 * (high - low) / (lines - 1)
    middle = 0.5 * (low + high)
    unknown = jnp.diag((high - low) ** 2 / 12.0)

    def fitted():
        later, fit, honest = follow_peak(peak, track, signal, valid)
        inside = jnp.all((fit.location_m > low - half_pitch) & (fit.location_m < high + half_pitch))
        certain = jnp.all(jnp.diagonal(fit.covariance_m2) < half_pitch**2)
        finite = jnp.all(jnp.isfinite(fit.location_m))
        located = inside & certain & finite
        return later, (fit.location_m, fit.covariance_m2, fit.widening, fit.residual_counts, honest, located)

    def absent():
        none = jnp.zeros_like(middle[0])
        nowhere = middle, unknown, none + 1.0, none, valid, jnp.asarray(False)
        return no_peak(peak), nowhere

    return jax.lax.cond(near, fitted, absent)
