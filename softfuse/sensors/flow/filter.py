"""Thermal flow sensors on vented cavities: volts to volume change.

    Q = (V - V0) / S,   dPhi = -integral of Q dt,

Q [m^3/s] is positive out of the cavity, so a cavity that is squeezed has a negative volume change. S is the
sensitivity [V s/m^3]. V stands for the unit of the channel, counts where it is digital.

The zero V0 wanders, and an error of 1 mV integrates to 8.3 mm^3 in 10 s. It is tracked by a Kalman filter
(zero_drift) while nothing touches and only predicted while something does. Tracking must not eat real flow:
* the filter runs `lag` frames behind the readings, and when a touch is seen, the frames of the lag are
  integrated, not tracked: flow that began before the touch was recognised is not lost;
* after a release, air flows back: the zero is tracked again, and the integral reset, when nothing has touched
  and the mean over the lag has agreed with the predicted zero within `gate_sigma` standard deviations
  for `hold_off_s`;
* a zero that has truly jumped would never pass that gate: after `relearn_s` without touch the filter is
  reset.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.sensors.reading_drift import DriftModel, ReadingDrift
from softfuse.sensors.zero_drift import (
    ZeroDrift,
    ZeroEstimate,
    observe_zero,
    predict_zero,
    restart_integral,
    zero_prior,
    zero_variance,
)


class FlowSensor(eqx.Module):
    """Parameters of k equal flow sensors; every field but `lag` is a leaf."""

    zero_V: Float[Array, " k"]
    """(k,) nominal zero [V]."""
    sensitivity_Vs_m3: Float[Array, " k"]
    """(k,) sensitivity S [V s/m^3]."""
    low_V: Float[Array, ""]
    """Readings at or below are clipped [V]."""
    high_V: Float[Array, ""]
    """Readings at or above are clipped or beyond the linear range [V]."""
    drift: ZeroDrift
    """Noise model of the zero."""
    hold_off_s: Float[Array, ""]
    """Time after touch or flow in which the zero is not tracked [s]; at least that of `lag` frames."""
    gate_sigma: Float[Array, ""]
    """Largest deviation of the lag's mean from the predicted zero that is quiet [standard deviations]."""
    relearn_s: Float[Array, ""]
    """Time without touch and without quiet after which the zero is learnt anew [s]."""
    longest_gap_s: Float[Array, ""]
    """Longest time between two readings that is bridged by the trapezoidal rule [s]."""
    lost_sigma_V: Float[Array, ""]
    """Standard deviation of the unknown flow while a channel is clipped or missing [V]."""
    lost_tolerance_s: Float[Array, ""]
    """Time of unknown flow since the reset up to which a volume is still called valid [s]."""
    lag: int = eqx.field(static=True)
    """Number of frames by which the zero filter runs behind."""


class FlowState(eqx.Module):
    """Memory of the flow sensors: the zero and the integral `lag` frames ago and the frames since."""

    zero: ZeroEstimate
    integral_Vs: Float[Array, " k"]
    lost_s: Float[Array, " k"]
    saturated: Bool[Array, " k"]
    released_s: Float[Array, ""]
    calm_s: Float[Array, " k"]
    unquiet_s: Float[Array, " k"]
    last_V: Float[Array, " k"]
    seen: Bool[Array, " k"]
    pending_s: Float[Array, " k"]
    lag_dt_s: Float[Array, " n"]
    lag_V: Float[Array, "n k"]
    lag_area_Vs: Float[Array, "n k"]
    lag_lost_s: Float[Array, "n k"]
    lag_usable: Bool[Array, "n k"]
    lag_saturated: Bool[Array, "n k"]


class FlowReading(eqx.Module):
    """What the flow sensors say about one frame."""

    flow_m3_s: Float[Array, " k"]
    """(k,) flow out of the cavities [m^3/s]."""
    volume_change_m3: Float[Array, " k"]
    """(k,) volume change since the reset [m^3]."""
    volume_sigma_m3: Float[Array, " k"]
    """(k,) its standard deviation: noise, error and wander of the zero, lost flow [m^3]."""
    volume_valid: Bool[Array, " k"]
    """(k,) no more than the tolerated time of flow was lost since the reset."""
    saturated: Bool[Array, " k"]
    """(k,) the channel was clipped at some time since the reset."""
    missing: Bool[Array, " k"]
    """(k,) no reading in this frame."""
    zero_V: Float[Array, " k"]
    """(k,) predicted zero now [V]."""
    drift: ReadingDrift
    """What the volume change is off by, if no flow was lost."""


def flow_drift(sensor: FlowSensor) -> DriftModel:
    """How volume changes (k,) [m³] drift: a volt second too much is so much volume too little."""
    k = sensor.zero_V.shape
    zero = jax.tree.map(lambda value: jnp.broadcast_to(value, k), sensor.drift)
    return DriftModel(zero, -1.0 / sensor.sensitivity_Vs_m3)


def flow_init(sensor: FlowSensor) -> FlowState:
    """State before the first frame, untouched."""
    # A state of other dtypes than its successor's would compile the update twice.
    nominal = jnp.asarray(sensor.zero_V, float)
    k = nominal.shape[0]
    n = sensor.lag
    return FlowState(
        zero=zero_prior(sensor.drift, nominal),
        integral_Vs=jnp.zeros(k),
        lost_s=jnp.zeros(k),
        saturated=jnp.zeros(k, bool),
        released_s=jnp.asarray(sensor.hold_off_s, float),
        calm_s=jnp.full(k, sensor.hold_off_s, float),
        unquiet_s=jnp.zeros(k),
        last_V=nominal,
        seen=jnp.zeros(k, bool),
        pending_s=jnp.zeros(k),
        lag_dt_s=jnp.zeros(n),
        lag_V=jnp.broadcast_to(nominal, (n, k)),
        lag_area_Vs=jnp.zeros((n, k)),
        lag_lost_s=jnp.zeros((n, k)),
        lag_usable=jnp.zeros((n, k), bool),
        lag_saturated=jnp.zeros((n, k), bool),
    )


def flow_unknown(sensor: FlowSensor, state: FlowState) -> FlowState:
    """State in which flow has been lost before, so that no volume is known until the next reset."""
    lost = sensor.lost_tolerance_s + sensor.relearn_s
    return eqx.tree_at(lambda s: s.lost_s, state, jnp.zeros_like(state.lost_s) + lost)


def _lag_deviation(sensor: FlowSensor, state: FlowState) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Mean of the lag's readings minus the zero in standard deviations, and the number of usable readings."""
    count = jnp.sum(state.lag_usable, axis=0)
    mean = jnp.sum(jnp.where(state.lag_usable, state.lag_V, 0.0), axis=0) / jnp.maximum(count, 1)
    variance = zero_variance(state.zero) + sensor.drift.noise_V**2 / jnp.maximum(count, 1)
    deviation = (mean - state.zero.bias_V - state.zero.wander_V) / jnp.sqrt(variance)
    return jnp.where(count > 0, deviation, 0.0), count


def mean_flow(sensor: FlowSensor, state: FlowState) -> Float[Array, " k"]:
    """Mean flow (k,) out of the cavities over the lag, in standard deviations."""
    variance = zero_variance(state.zero) + sensor.drift.noise_V**2 / sensor.lag
    mean = jnp.mean(state.lag_V, axis=0) - state.zero.bias_V - state.zero.wander_V
    return mean / jnp.sqrt(variance)


def _push(
    sensor: FlowSensor, state: FlowState, dt_s: Float[Array, ""], flow_V: Float[Array, " k"]
) -> FlowState:
    """Append a frame to the lag and drop the oldest, which the caller has taken."""
    present = jnp.isfinite(flow_V)
    reading = jnp.where(present, flow_V, state.last_V)
    clipped = present & ((reading <= sensor.low_V) | (reading >= sensor.high_V))
    known = present & state.seen
    # Trapezoid from the last reading of the channel; a missing one is held until the next tells the slope.
    held = jnp.where(state.seen, state.last_V, reading)
    area = 0.5 * (held + reading) * dt_s + jnp.where(known, 0.5 * (reading - held) * state.pending_s, 0.0)
    interval = state.pending_s + dt_s
    lost = jnp.where(clipped, dt_s, 0.0)
    lost = jnp.where(known & (interval > sensor.longest_gap_s), interval, lost)
    lost = jnp.where(present & ~state.seen, interval, lost)

    def append(lag, new):
        return jnp.concatenate([lag[1:], jnp.asarray(new)[None]])

    return eqx.tree_at(
        lambda s: (
            s.last_V, s.seen, s.pending_s,
            s.lag_dt_s, s.lag_V, s.lag_area_Vs, s.lag_lost_s, s.lag_usable, s.lag_saturated,
        ),
        state,
        (
            reading,
            state.seen | present,
            jnp.where(present, 0.0, interval),
            append(state.lag_dt_s, dt_s),
            append(state.lag_V, reading),
            append(state.lag_area_Vs, area),
            append(state.lag_lost_s, lost),
            append(state.lag_usable, present & ~clipped),
            append(state.lag_saturated, clipped),
        ),
    )  # fmt: skip


def _advance(
    sensor: FlowSensor, state: FlowState, dt_s: Float[Array, ""], touching: Bool[Array, ""]
) -> FlowState:
    """Move zero and integral over the oldest frame of the lag: track or integrate."""
    deviation, count = _lag_deviation(sensor, state)
    flowing = jnp.abs(deviation) >= sensor.gate_sigma
    calm = jnp.where(touching | flowing, 0.0, state.calm_s + dt_s)
    quiet = (calm > sensor.hold_off_s) & (2 * count >= sensor.lag)
    unquiet = jnp.where(~touching & flowing, state.unquiet_s + dt_s, 0.0)
    relearn = unquiet > sensor.relearn_s
    prior = zero_prior(sensor.drift, sensor.zero_V)
    zero = ZeroEstimate(
        bias_V=jnp.where(relearn, prior.bias_V, state.zero.bias_V),
        wander_V=jnp.where(relearn, prior.wander_V, state.zero.wander_V),
        covariance=jnp.where(relearn[:, None, None], prior.covariance, state.zero.covariance),
    )
    oldest_dt = state.lag_dt_s[0]
    zero, zero_area = predict_zero(sensor.drift, zero, oldest_dt, jnp.ones(()))
    oldest = state.lag_V[0]
    spread = jnp.sqrt(zero_variance(zero) + sensor.drift.noise_V**2)
    likely = jnp.abs(oldest - zero.bias_V - zero.wander_V) < sensor.gate_sigma * spread
    # Only the frame that leaves the lag is known to precede any touch that the next frames may reveal.
    zero = observe_zero(sensor.drift, zero, oldest, quiet & likely & state.lag_usable[0] & (oldest_dt > 0))
    zero = restart_integral(zero, quiet)
    return eqx.tree_at(
        lambda s: (s.zero, s.integral_Vs, s.lost_s, s.saturated, s.released_s, s.calm_s, s.unquiet_s),
        state,
        (
            zero,
            jnp.where(quiet, 0.0, state.integral_Vs + state.lag_area_Vs[0] - zero_area),
            jnp.where(quiet, 0.0, state.lost_s + state.lag_lost_s[0]),
            ~quiet & (state.saturated | state.lag_saturated[0]),
            jnp.where(touching, 0.0, state.released_s + dt_s),
            calm,
            unquiet,
        ),
    )


def flow_update(
    sensor: FlowSensor,
    state: FlowState,
    dt_s: Float[Array, ""],
    flow_V: Float[Array, " k"],
    touching: Bool[Array, ""],
) -> tuple[FlowState, FlowReading]:
    """One frame.

    Args: dt_s time since the last frame [s], 0 for the first; flow_V (k,) readings [V], NaN where missing;
    touching: whether something touches the body in this frame.
    Returns: the new state and the FlowReading.
    """
    state = _push(sensor, _advance(sensor, state, dt_s, touching), dt_s, flow_V)
    frames = jnp.sum(state.lag_dt_s > 0)
    ahead, zero_area = predict_zero(sensor.drift, state.zero, jnp.sum(state.lag_dt_s), frames)
    integral = state.integral_Vs + jnp.sum(state.lag_area_Vs, axis=0) - zero_area
    lost = state.lost_s + jnp.sum(state.lag_lost_s, axis=0) + state.pending_s
    missing = ~jnp.isfinite(flow_V)
    sigma = jnp.sqrt(ahead.covariance[:, 2, 2] + (sensor.lost_sigma_V * lost) ** 2)
    zero = ahead.bias_V + ahead.wander_V
    return state, FlowReading(
        flow_m3_s=(state.last_V - zero) / sensor.sensitivity_Vs_m3,
        volume_change_m3=-integral / sensor.sensitivity_Vs_m3,
        volume_sigma_m3=sigma / sensor.sensitivity_Vs_m3,
        volume_valid=state.seen & ~missing & (lost <= sensor.lost_tolerance_s),
        saturated=state.saturated | jnp.any(state.lag_saturated, axis=0),
        missing=missing,
        zero_V=zero,
        drift=ReadingDrift(ahead.covariance, state.calm_s > 0.0, jnp.asarray(dt_s, float)),
    )
