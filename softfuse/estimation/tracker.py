"""Sensor frames in, contact, force and shape out: the pad's sensors and the estimator, frame after frame.

The sensors decide whether something touches and where; while it does, each frame's volume changes drive one
estimate step; on release the body is taken to rest again. What cannot be trusted gets a status, and a number
that would be a guess is NaN. Nothing here is threaded or reads files; `hardware` does that.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.device import Device
from softfuse.estimation.estimator import DEFAULT_STEPS, Estimator, StepSettings
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation
from softfuse.sensing import PadMeasurement, PadSensors, pad_sensor_init, pad_sensor_update


class Status(StrEnum):
    """What is to be said about a frame; a frame may have several."""

    ok = "ok"
    no_contact = "no contact"
    bad_time = "time missing or not increasing"
    flow_missing = "flow missing"
    flow_saturated = "flow saturated"
    flow_lost = "no volume known"
    electrode_lost = "electrode lost"
    location_unknown = "location unknown"
    outside = "outside workspace"
    force_limit = "force limit"
    poor_fit = "poor fit"
    not_optimal = "optimum not reached"
    inverted = "inverted element"


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of readings: time [s], flow (k,) [V], rows (r,) and columns (c,) of electrodes [counts].

    NaN stands for what is missing.
    """

    time_s: float
    flow_V: Float[np.ndarray, " k"]
    row_counts: Float[np.ndarray, " r"]
    column_counts: Float[np.ndarray, " c"]


@dataclass(frozen=True, eq=False)
class Tracked:
    """What one frame says.

    `contacts`: how many touch; `location_m` (2,) and `force_N`: NaN where unknown, force 0 without contact;
    `volume_change_m3`, `volume_sigma_m3` (k,): measured; `misfit_m3` (k,): measured minus modelled, NaN
    without an estimate; `image` (c, r): s_col ⊗ s_row [counts²]; `latency_s`: wall time of the frame.
    """

    time_s: float
    contacts: int
    location_m: Float[np.ndarray, "2"]
    force_N: float
    volume_change_m3: Float[np.ndarray, " k"]
    volume_sigma_m3: Float[np.ndarray, " k"]
    misfit_m3: Float[np.ndarray, " k"]
    image: Float[np.ndarray, "c r"]
    statuses: tuple[Status, ...]
    latency_s: float

    @property
    def residual_m3(self) -> float:
        """Root mean square misfit over the cavities that took part [m³]; NaN without an estimate."""
        known = self.misfit_m3[np.isfinite(self.misfit_m3)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


@dataclass(frozen=True, eq=False)
class TrackerSettings:
    """Where contacts may be, and when an estimate is doubted.

    `workspace_m` (2, 2): lowest and highest x, y of a contact's centre [m]; `poor_fit` [-]: a largest misfit
    above this part of the largest volume change is flagged.
    """

    workspace_m: Float[np.ndarray, "2 2"]
    poor_fit: float = 0.25


def fitted_location(seen: PadMeasurement) -> Float[Array, "2"]:
    """The location (2,) [m] of the peak fit."""
    return seen.location_m


def mean_location(seen: PadMeasurement) -> Float[Array, "2"]:
    """The location (2,) [m] of the paper's weighted mean, which is pulled inwards at the border."""
    return seen.weighted_mean_m


class Tracker:
    """Follows one contact on a pad through the frames of its sensors; compiled when made."""

    def __init__(
        self,
        sensors: PadSensors,
        device: Device,
        limits: Limits,
        settings: TrackerSettings,
        steps: StepSettings = DEFAULT_STEPS,
        *,
        locate: Callable[[PadMeasurement], Float[Array, "2"]] = fitted_location,
    ):
        """Compile sensors and estimate step.

        Raises SolveError when the body cannot be estimated (see `Estimator`) or the limits are for more than
        the one contact that crossed lines can locate.
        """
        self.estimator = Estimator(device, limits, jnp.zeros((1, 3)), steps)
        self.settings = settings
        self._force_limit = float(limits.upper[0])
        self._first = pad_sensor_init(sensors)
        arrays, static = eqx.partition(sensors, eqx.is_array)
        self._arrays = arrays

        def sense(arrays, state, time_s, flow, rows, columns):
            state, seen = pad_sensor_update(eqx.combine(arrays, static), state, time_s, flow, rows, columns)
            return state, seen, locate(seen)

        shapes = (sensors.flow.zero_V, sensors.peak.row_y_m, sensors.peak.column_x_m)
        example = (jnp.zeros(()), *(jnp.zeros(like.shape) for like in shapes))
        started = time.perf_counter()
        self._sense = jax.jit(sense).lower(arrays, self._first, *example).compile()
        self.compile_s = self.estimator.compile_s + time.perf_counter() - started
        self.reset()

    @property
    def z(self) -> Float[Array, " n"]:
        """The body's unknowns (n,) after the last frame; `device.body.displacement` makes a shape of them."""
        return self.estimator.state.z

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._memory, self._begun = self._first, False
        self.estimator.reset()

    def update(self, frame: Frame) -> Tracked:
        """Advance by one frame; never raises for what its readings are, only for their number."""
        started = time.perf_counter()
        readings = (frame.time_s, frame.flow_V, frame.row_counts, frame.column_counts)
        self._memory, seen, location = self._sense(
            self._arrays, self._memory, *(jnp.asarray(reading, float) for reading in readings)
        )
        seen, location = jax.device_get((seen, location))
        counts = np.concatenate([frame.row_counts, frame.column_counts])
        # In the first frame no electrode has a baseline yet.
        lost = ~seen.electrode_valid if self._begun else ~np.isfinite(counts)
        self._begun = True
        flags = _sensor_flags(seen, lost)
        force, misfit = 0.0, np.full(seen.volume_change_m3.shape, np.nan)
        if not seen.touching:
            self.estimator.reset()
            location = np.full(2, np.nan)
            flags.insert(0, Status.no_contact)
        else:
            force = float("nan")
            low, high = self.settings.workspace_m
            if not seen.location_valid:
                location = np.full(2, np.nan)
                flags.append(Status.location_unknown)
            elif np.any(location < low) or np.any(location > high):
                flags.append(Status.outside)
            elif not np.any(seen.volume_valid):
                flags.append(Status.flow_lost)
            else:
                force, misfit, doubts = self._estimate(seen, location)
                flags.extend(doubts)
        return Tracked(
            frame.time_s,
            int(seen.touching),
            location,
            force,
            seen.volume_change_m3,
            seen.volume_sigma_m3,
            misfit,
            seen.image,
            tuple(flags) or (Status.ok,),
            time.perf_counter() - started,
        )

    def _estimate(self, seen: PadMeasurement, location: np.ndarray) -> tuple[float, np.ndarray, list[Status]]:
        weight = np.where(seen.volume_valid, 1 / np.asarray(seen.volume_sigma_m3), 0.0)
        place = jnp.asarray([[*location, 0.0]])
        found = self.estimator.update(
            Observation(jnp.asarray(seen.volume_change_m3), jnp.asarray(weight), place)
        )
        if found.lost:
            return float("nan"), np.full(weight.shape, np.nan), [Status.inverted]
        force, doubts = float(found.drive[0]), []
        # The cells' forces add up to the limit only up to rounding.
        if force >= self._force_limit * (1 - 1e-9):
            doubts.append(Status.force_limit)
        misfit = np.where(weight > 0, found.misfit, np.nan)
        largest = np.max(np.abs(seen.volume_change_m3), where=weight > 0, initial=0.0)
        noise = 5 * np.max(seen.volume_sigma_m3, where=weight > 0, initial=0.0)
        if np.nanmax(np.abs(misfit)) > max(self.settings.poor_fit * largest, noise):
            doubts.append(Status.poor_fit)
        if float(found.report.kkt) > 1e-6:
            doubts.append(Status.not_optimal)
        return force, misfit, doubts


def _sensor_flags(seen: PadMeasurement, lost: np.ndarray) -> list[Status]:
    said = (
        (not seen.time_valid, Status.bad_time),
        (np.any(seen.flow_missing), Status.flow_missing),
        (np.any(seen.flow_saturated), Status.flow_saturated),
        (np.any(lost), Status.electrode_lost),
    )
    return [status for true, status in said if true]
