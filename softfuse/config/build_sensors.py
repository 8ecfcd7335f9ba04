"""From settings to the measurement models of the sensors."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.robot.settings import RobotSettings
from softfuse.config.sensors import CapacitiveSettings, FlowSettings
from softfuse.errors import ConfigError
from softfuse.sensors import (
    CapacitiveArray,
    FlowSensor,
    PadSensors,
    PeakModel,
    TouchDetector,
    capacitive_array,
    d6f_p0001a1,
    peak_model,
    touch_detector,
)


def build_sensors(config: RobotSettings) -> PadSensors:
    """All measurement models of a pad; raises ConfigError when the device has other sensors or none, or no
    contact radius.
    """
    if config.sensors is None:
        raise ConfigError(f"{config.path}: sensors: missing, needed to estimate from a recording")
    if config.contact is None:
        raise ConfigError(f"{config.path}: contact: missing, its radius is needed to locate contacts")
    capacitive = config.sensors.capacitive
    return PadSensors(
        flow=flow_sensor(config.sensors.flow),
        array=electrode_array(capacitive),
        peak=contact_peak(capacitive, config.contact.radius),
        touch=touch_thresholds(capacitive),
    )


def flow_sensor(settings: FlowSettings) -> FlowSensor:
    """The flow sensors, one per channel."""
    count = len(settings.channels)
    sensor = d6f_p0001a1(
        count,
        low_V=settings.low,
        high_V=settings.high,
        noise_V=settings.noise,
        bias_sigma_V=settings.bias_sigma,
        bias_walk_V=settings.bias_walk,
        wander_sigma_V=settings.wander_sigma,
        wander_time_s=settings.wander_time,
        hold_off_s=settings.hold_off,
        gate_sigma=settings.gate_sigma,
        relearn_s=settings.relearn,
        longest_gap_s=settings.longest_gap,
        lost_sigma_V=settings.lost_sigma,
        lost_tolerance_s=settings.lost_tolerance,
        lag=settings.lag_frames,
    )
    sensitivity = settings.sensitivity * jnp.broadcast_to(jnp.array(settings.gain), (count,))
    return replace(sensor, zero_V=jnp.full(count, settings.zero), sensitivity_Vs_m3=sensitivity)


def electrode_array(settings: CapacitiveSettings) -> CapacitiveArray:
    """The electronics of the array and how its baseline is followed."""
    baseline = settings.baseline
    return capacitive_array(
        noise_counts=settings.noise_counts,
        lowest_counts=settings.lowest_counts,
        highest_counts=settings.highest_counts,
        stuck_frames=settings.stuck_frames,
        baseline_time_s=baseline.time,
        creep_time_s=baseline.creep_time,
        recovery_time_s=baseline.recovery_time,
        negative_sigma=baseline.negative_sigma,
        gain=line_gains(settings),
        untouched_counts=_untouched(settings),
    )


def line_gains(settings: CapacitiveSettings) -> Float[Array, " e"]:
    """The gains of all lines (e,), rows first."""
    each = ((settings.row_gain, settings.row_y), (settings.column_gain, settings.column_x))
    return jnp.concatenate([jnp.broadcast_to(jnp.array(gain), (len(lines),)) for gain, lines in each])


def _untouched(settings: CapacitiveSettings) -> Float[Array, " e"]:
    """What all lines (e,) read untouched, rows first [counts]; ∞ where that is not known."""
    if settings.row_baseline is None or settings.column_baseline is None:
        return jnp.full(len(settings.row_y) + len(settings.column_x), jnp.inf)
    return jnp.array([*settings.row_baseline, *settings.column_baseline])


def contact_peak(settings: CapacitiveSettings, radius: float) -> PeakModel:
    """The peak that a contact of a radius in m leaves on the array."""
    peak = settings.peak
    return peak_model(
        jnp.asarray(settings.row_y),
        jnp.asarray(settings.column_x),
        settings.row_depth,
        settings.column_depth,
        radius_m=radius,
        radius_sigma_m=peak.radius_sigma,
        gap_sigma_m=peak.gap_sigma,
        offset_sigma_counts=peak.offset_sigma_counts,
        noise_counts=settings.noise_counts,
        model_error=peak.model_error,
    )


def touch_thresholds(settings: CapacitiveSettings) -> TouchDetector:
    """When something is near, touches, and is gone."""
    touch = settings.touch
    return touch_detector(
        noise_counts=settings.noise_counts,
        near_on_sigma=touch.near_on_sigma,
        near_off_sigma=touch.near_off_sigma,
        contact_on_counts=touch.contact_on_counts,
        flow_sigma=touch.flow_sigma,
        release_fraction=touch.release_fraction,
        return_fraction=touch.return_fraction,
        on_frames=touch.on_frames,
        off_frames=touch.off_frames,
    )
