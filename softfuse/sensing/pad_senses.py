"""The pad's sensors in the terms of the estimator: volumes of vented cavities, one contact on crossed
lines.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.sensing.array_pose import ArrayPose
from softfuse.sensing.flow import flow_drift
from softfuse.sensing.pad import PadMeasurement, PadSensors, pad_sensor_init, pad_sensor_update
from softfuse.sensing.senses import AbstractSenses, Sensed
from softfuse.sensing.status import Status


def fitted_location(seen: PadMeasurement) -> Float[Array, "2"]:
    """The location (2,) [m] of the peak fit."""
    return seen.location_m


def mean_location(seen: PadMeasurement) -> Float[Array, "2"]:
    """The location (2,) [m] of the paper's weighted mean, which is pulled inwards at the border."""
    return seen.weighted_mean_m


class PadSenses(AbstractSenses):
    """Flow sensors and electrodes; groups of readings: flow [V], rows and columns [counts].

    `workspace_m` (2, 2): lowest and highest x, y of a contact's middle [m]; `locate`: which location counts.
    """

    sensors: PadSensors
    workspace_m: Float[Array, "2 2"]
    locate: Callable[[PadMeasurement], Float[Array, "2"]] = eqx.field(static=True, default=fitted_location)
    pose: ArrayPose = eqx.field(default_factory=ArrayPose.as_drawn)

    @property
    def channels(self):
        """Cavities, rows, columns."""
        peak = self.sensors.peak
        return self.sensors.flow.zero_V.shape[0], peak.row_y_m.shape[0], peak.column_x_m.shape[0]

    @property
    def misses(self):
        """What does not conduct is not seen."""
        return True

    @property
    def drift(self):
        """That of the flow sensors' zero."""
        return flow_drift(self.sensors.flow)

    def init(self):
        """State before the first frame; the pad is taken to be untouched."""
        return pad_sensor_init(self.sensors)

    def update(self, state, time_s, readings):
        """One frame of flow (k,) [V], rows (r,) and columns (c,) [counts]."""
        begun = jnp.isfinite(state.clock.time_s)
        state, seen = pad_sensor_update(self.sensors, state, time_s, *readings)
        low, high = self.workspace_m
        # What electrodes do not see may be anywhere.
        location = jnp.where(seen.felt, 0.5 * (low + high), self.pose.on_body(self.locate(seen)))
        inside = jnp.all((location >= low) & (location <= high))
        known = seen.volume_valid.any()
        # In the first frame no electrode has a baseline yet.
        read = jnp.isfinite(jnp.concatenate(readings[1:]))
        lost = jnp.where(begun, ~seen.electrode_valid, ~read)
        touching, located = seen.touching, seen.touching & seen.location_valid
        flags = {
            Status.bad_time: ~seen.time_valid,
            Status.clock_anew: seen.clock_anew,
            Status.flow_missing: jnp.any(seen.flow_missing),
            Status.flow_saturated: jnp.any(seen.flow_saturated),
            Status.electrode_lost: jnp.any(lost),
            Status.location_unknown: touching & ~seen.location_valid & ~seen.felt,
            Status.unseen: seen.felt,
            Status.outside: located & ~inside,
            Status.volume_unknown: ((located & inside) | seen.felt) & ~known,
        }
        place = jnp.append(location, 0.0)
        dent = seen.dent_m(self.sensors.peak.radius_m)
        spread = self.pose.spread(seen.location_covariance_m2, seen.location_widening, dent)
        deviation = jnp.sqrt(jnp.diagonal(spread))
        anywhere = (high - low) / jnp.sqrt(12.0)
        return state, Sensed(
            reading=seen.volume_change_m3,
            sigma=seen.volume_sigma_m3,
            valid=seen.volume_valid,
            touching=touching[None],
            pressing=(((located & inside) | seen.felt) & known)[None],
            clear=~touching,
            places=place[None],
            location_m=jnp.where(located, place, jnp.nan)[None],
            location_sigma_m=jnp.where(seen.felt, anywhere, jnp.where(located, deviation, jnp.nan))[None],
            flags=flags,
            details=seen,
            drift=seen.drift,
        )
