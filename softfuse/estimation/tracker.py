"""Sensor frames in, contacts, forces and shape out: a device's senses and the estimator, frame after frame.

The senses decide what touches and where; each frame's readings drive one estimate step, in which only those
contacts may press that are touched. While nothing touches a device to which nothing is attached, its body is
taken to rest. What the model misses while nothing is near is taken off the readings of the touch that follows
(`model_offset`). What cannot be trusted gets a status, and a number that would be a guess is NaN. Nothing
here is threaded, but for compiling, or reads files; `hardware` does that.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from softfuse.equilibrium.solution import State
from softfuse.estimation.atlas import Atlas
from softfuse.estimation.compiled_senses import CompiledSenses, Finding
from softfuse.estimation.device import Device
from softfuse.estimation.estimator import DEFAULT_STEPS, Estimate, Estimator, StepSettings
from softfuse.estimation.limits import Limits
from softfuse.estimation.model_error import ModelError, whitening
from softfuse.estimation.model_offset import ModelOffset
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.estimation.step import Observation
from softfuse.sensing.senses import AbstractSenses, Sensed
from softfuse.sensing.status import Status


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of readings: time [s] and groups of channels (n,) in the units of the device's senses.

    NaN stands for what is missing.
    """

    time_s: float
    readings: tuple[Float[np.ndarray, " n"], ...]


@dataclass(frozen=True, eq=False)
class Tracked:
    """What one frame says of c contacts, k readings and what is attached.

    `touching` (c,): what touches; `location_m` (c, 3): where on the body at rest, NaN where unknown;
    `location_sigma_m` (c, 2): standard deviations of x and y, NaN where unknown or not a number of the
    senses'; `contact_force_N` (c,): NaN where unknown, 0 where nothing touches; `force_covariance_N2` (c, c):
    see `force_covariance`, NaN where the force is; `attached` (a,): what the attached
    loads are driven with; `reading`, `sigma` (k,): measured; `misfit` (k,): measured minus modelled, NaN
    without an estimate and where a reading took no part; `details`: the senses' own measurement;
    `latency_s`: wall time of the frame.
    """

    time_s: float
    touching: Bool[np.ndarray, " c"]
    location_m: Float[np.ndarray, "c 3"]
    location_sigma_m: Float[np.ndarray, "c 2"]
    contact_force_N: Float[np.ndarray, " c"]
    force_covariance_N2: Float[np.ndarray, "c c"]
    attached: Float[np.ndarray, " a"]
    reading: Float[np.ndarray, " k"]
    sigma: Float[np.ndarray, " k"]
    misfit: Float[np.ndarray, " k"]
    details: Any
    statuses: tuple[Status, ...]
    latency_s: float

    @property
    def contacts(self) -> int:
        """How many touch."""
        return int(self.touching.sum())

    @property
    def force_N(self) -> float:
        """Sum of the contacts' forces [N]; NaN when one is unknown."""
        return float(np.sum(self.contact_force_N))

    @property
    def contact_sigma_N(self) -> Float[np.ndarray, " c"]:
        """Standard deviation (c,) of each contact's force [N]."""
        return np.sqrt(np.diag(self.force_covariance_N2))

    @property
    def force_sigma_N(self) -> float:
        """Standard deviation of the sum of the contacts' forces [N]; NaN when one is unknown."""
        return float(np.sqrt(np.sum(self.force_covariance_N2)))

    @property
    def centre_m(self) -> Float[np.ndarray, "3"]:
        """Force-weighted middle of the contacts (3,) [m]; their mean without forces, NaN without contacts."""
        if not self.contacts:
            return np.full(3, np.nan)
        return self._shares[self._shares > 0] @ self.location_m[self._shares > 0]

    @property
    def _shares(self) -> Float[np.ndarray, " c"]:
        """How much each contact counts for their middle (c,), in all 1 where there are some."""
        force = np.where(self.touching, self.contact_force_N, 0.0)
        weight = force if force.sum() > 0 else self.touching.astype(float)
        return np.where(weight > 0, weight, 0.0) / max(weight[weight > 0].sum(), np.finfo(float).tiny)

    @property
    def centre_sigma_m(self) -> Float[np.ndarray, "2"]:
        """Standard deviations (2,) of its x and y [m], of contacts that are located independently; NaN where
        one is unknown.
        """
        share = self._shares[self._shares > 0]
        if not self.contacts:
            return np.full(2, np.nan)
        return np.sqrt(share**2 @ self.location_sigma_m[self._shares > 0] ** 2)

    @property
    def residual(self) -> float:
        """Root mean square misfit of the readings that took part; NaN without an estimate."""
        known = self.misfit[np.isfinite(self.misfit)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


@dataclass(frozen=True)
class TrackerSettings:
    """When an estimate is doubted: `poor_fit` [-], a misfit above this part of the largest reading;
    `model_error`, by how much the model may be wrong; and `offset_s` [s], over which time what the model
    misses is averaged.
    """

    poor_fit: float = 0.25
    model_error: ModelError = ModelError()
    offset_s: float = 1.0


class _Estimated(NamedTuple):
    """Drives (D,), their covariance (D, D), measured minus modelled readings (k,), and what is doubted."""

    drive: Float[np.ndarray, " D"]
    covariance: Float[np.ndarray, "D D"]
    misfit: Float[np.ndarray, " k"]
    doubts: list[Status]


def force_covariance(found: Estimate, limits: Limits) -> Float[np.ndarray, "D D"]:
    """Covariance (D, D) of the drives of an estimate, of those within their limits the inverse of their
    information.

    One that is held at a limit has the variance that it would have alone, if it could move: by so much the
    readings let it be wrong; one that has no room has none.
    """
    lower, upper = np.asarray(limits.lower), np.asarray(limits.upper)
    information, room = found.report.information, 1e-9 * (upper - lower)
    movable = upper > lower
    free = movable & (found.drive > lower + room) & (found.drive < upper - room)
    alone = np.where(movable & ~free, 1 / np.diag(information), 0.0)
    covariance = np.diag(alone)
    covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
    return covariance


class Tracker:
    """Follows the contacts on a device through the frames of its sensors; compiled when made."""

    def __init__(
        self,
        senses: AbstractSenses,
        device: Device | Atlas,
        limits: Limits,
        settings: TrackerSettings = TrackerSettings(),
        steps: StepSettings = DEFAULT_STEPS,
    ):
        """Compile senses and estimate step, of the device or of its charts.

        Raises SolveError when the body cannot be estimated or the limits do not fit, see `Estimator`; and
        SoftfuseError for a chart that cannot be read.
        """
        self.settings = settings
        started = time.perf_counter()
        with ThreadPoolExecutor(1) as aside:
            self._senses = CompiledSenses(senses, aside)
            places = self._senses.places
            self.estimator: Estimator | ReducedEstimator
            if isinstance(device, Atlas):
                self.estimator = ReducedEstimator(device, limits, places, steps)
            else:
                self.estimator = Estimator(device, limits, places, steps)
        device = self.estimator.device
        self.compile_s = time.perf_counter() - started
        self._limits, self._upper = limits, np.asarray(limits.upper)
        self._split = places.shape[0] * device.contact.drives
        # A contact's forces together: the sum over its drives.
        self._adding = np.kron(np.eye(places.shape[0]), np.ones(device.contact.drives))
        free = self._upper[self._split :] > np.asarray(limits.lower)[self._split :]
        gauges = np.array(device.gauges, int)
        self._strokes = device.readings - len(gauges) + np.flatnonzero(free[gauges])
        self.reset()

    @property
    def state(self) -> State:
        """The body and its loads after the last frame; `device.body.displacement(z)` is the shape."""
        return self.estimator.state

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._senses.reset()
        self._stroke, self._seen_s = 0.0, -np.inf
        self._offset = ModelOffset.none(self.estimator.device.readings)
        self._force_N = np.zeros(len(self._adding))
        self.estimator.reset()

    def update(self, frame: Frame) -> Tracked:
        """Advance by one frame; never raises for what its readings are, only for their number."""
        started = time.perf_counter()
        found = self.estimate(frame.time_s, self.sense(frame))
        return replace(found, latency_s=time.perf_counter() - started)

    def sense(self, frame: Frame) -> Finding:
        """Advance the senses by one frame, without estimating: what it says, not yet read.

        Senses integrate, average and debounce, so that they want every frame, also where forces and shape
        are estimated from fewer.
        """
        return self._senses.update(frame.time_s, frame.readings)

    def estimate(self, time_s: float, finding: Finding) -> Tracked:
        """Forces and shape from what the senses said last, at `time_s` [s]."""
        started = time.perf_counter()
        sensed = finding.sensed
        said = [status for status, true in sensed.flags.items() if true]
        attached = len(self._upper) - self._split
        still = np.zeros((len(self._upper), len(self._upper)))
        found = _Estimated(np.zeros(len(still)), still, np.full(sensed.reading.shape, np.nan), [])
        if not sensed.touching.any():
            said.insert(0, Status.no_contact)
        if sensed.pressing.any() or attached:
            found = self._estimate(sensed, time_s)
            said += found.doubts
        elif not sensed.touching.any():
            self.estimator.reset()
        force = self._adding @ found.drive[: self._split]
        covariance = self._adding @ found.covariance[: self._split, : self._split] @ self._adding.T
        unknown = np.asarray(sensed.touching & ~sensed.pressing)
        self._force_N = np.nan_to_num(force)
        return Tracked(
            time_s,
            np.asarray(sensed.touching),
            np.asarray(sensed.location_m),
            np.asarray(sensed.location_sigma_m),
            np.where(unknown, np.nan, force),
            np.where(unknown[:, None] | unknown, np.nan, covariance),
            found.drive[self._split :],
            np.asarray(sensed.reading),
            np.asarray(sensed.sigma),
            found.misfit,
            sensed.details,
            tuple(said) or (Status.ok,),
            time.perf_counter() - started,
        )

    def _estimate(self, sensed: Sensed, time_s: float) -> _Estimated:
        clear, valid, places = bool(sensed.clear), np.asarray(sensed.valid), np.asarray(sensed.places)
        reading = sensed.reading if clear else sensed.reading - self._offset.at(self._stroke)
        allowed = np.ones(len(self._upper), bool)
        allowed[: self._split] = self._of_contacts(np.asarray(sensed.pressing))
        limits = self._limits._replace(upper=np.where(allowed, self._upper, 0.0))
        uncertain = self.settings.model_error.covariance(
            np.where(valid, reading, 0.0),
            np.asarray(sensed.sigma),
            places,
            np.asarray(sensed.location_sigma_m),
            self._force_N,
        )
        seen = Observation.on_host(np.asarray(reading), whitening(uncertain, valid), places)
        found = self.estimator.update(seen, limits)
        if found.lost:
            unknown = allowed & (np.arange(len(allowed)) < self._split)
            drive = np.where(unknown, np.nan, np.where(allowed, found.drive, 0.0))
            nothing = np.where(unknown[:, None] | unknown, np.nan, 0.0)
            return _Estimated(drive, nothing, np.full(valid.shape, np.nan), [Status.inverted])
        self._stroke = float(np.linalg.norm((reading - found.misfit)[self._strokes]))
        elapsed = time_s - self._seen_s
        if elapsed > 0:  # not where the time is missing or does not increase
            self._seen_s = time_s
            if clear and not float(found.report.taken) < 1.0:
                share = float(-np.expm1(-elapsed / self.settings.offset_s))
                self._offset = self._offset.learned(found.misfit, valid, self._stroke, share)
        misfit = np.where(valid, found.misfit, np.nan)
        doubts = self._doubts(sensed, np.sqrt(np.diag(uncertain)), found, misfit)
        return _Estimated(found.drive, force_covariance(found, limits), misfit, doubts)

    def _of_contacts(self, flags: Bool[np.ndarray, " c"]) -> Bool[np.ndarray, " d"]:
        """A flag of each contact for each of its drives (d,)."""
        return np.repeat(flags, self._split // len(flags))

    def _doubts(
        self,
        sensed: Sensed,
        sigma: Float[np.ndarray, " k"],
        found: Estimate,
        misfit: Float[np.ndarray, " k"],
    ) -> list[Status]:
        doubts = []
        # The cells' forces add up to the limit only up to rounding.
        at_limit = found.drive[: self._split] >= self._upper[: self._split] * (1 - 1e-9)
        if np.any(at_limit & self._of_contacts(np.asarray(sensed.pressing))):
            doubts.append(Status.force_limit)
        if found.corrected:
            doubts.append(Status.corrected)
        if float(found.report.taken) < 1.0:
            doubts.append(Status.lagging)
        if _poor(sensed, sigma, misfit, self.settings.poor_fit):
            doubts.append(Status.poor_fit)
        if not float(found.report.kkt) <= 1e-6:
            doubts.append(Status.not_optimal)
        return doubts


def _poor(
    sensed: Sensed, sigma: Float[np.ndarray, " k"], misfit: Float[np.ndarray, " k"], part: float
) -> bool:
    """Whether some misfit is beyond both what it may be, and a part of the largest reading, in standard
    deviations.
    """
    if not sensed.valid.any():
        return False
    size = np.where(sensed.valid, np.abs(sensed.reading) / sigma, 0.0)
    missing = np.where(sensed.valid, np.abs(misfit) / sigma, 0.0)
    return bool(missing.max() > max(part * size.max(), 5.0))
