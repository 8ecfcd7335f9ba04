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
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from softfuse.equilibrium.solution import State
from softfuse.estimation.atlas import Atlas
from softfuse.estimation.compiled_senses import CompiledSenses, Finding
from softfuse.estimation.device import Device
from softfuse.estimation.estimator import DEFAULT_STEPS, Estimate, Estimator, StepSettings
from softfuse.estimation.limits import Limits
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
    `contact_force_N` (c,): NaN where unknown, 0 where nothing touches; `attached` (a,): what the attached
    loads are driven with; `reading`, `sigma` (k,): measured; `misfit` (k,): measured minus modelled, NaN
    without an estimate and where a reading took no part; `details`: the senses' own measurement;
    `latency_s`: wall time of the frame.
    """

    time_s: float
    touching: Bool[np.ndarray, " c"]
    location_m: Float[np.ndarray, "c 3"]
    contact_force_N: Float[np.ndarray, " c"]
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
    def centre_m(self) -> Float[np.ndarray, "3"]:
        """Force-weighted middle of the contacts (3,) [m]; their mean without forces, NaN without contacts."""
        if not self.contacts:
            return np.full(3, np.nan)
        weight = np.where(self.touching, self.contact_force_N, 0.0)
        weight = weight if weight.sum() > 0 else self.touching.astype(float)
        bearing = weight > 0
        return weight[bearing] @ self.location_m[bearing] / weight[bearing].sum()

    @property
    def residual(self) -> float:
        """Root mean square misfit of the readings that took part; NaN without an estimate."""
        known = self.misfit[np.isfinite(self.misfit)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


@dataclass(frozen=True)
class TrackerSettings:
    """When an estimate is doubted: `poor_fit` [-], a misfit above this part of the largest reading; and
    `offset_s` [s], over which time what the model misses is averaged.
    """

    poor_fit: float = 0.25
    offset_s: float = 1.0


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
        drive, misfit = np.zeros(len(self._upper)), np.full(sensed.reading.shape, np.nan)
        if not sensed.touching.any():
            said.insert(0, Status.no_contact)
        if sensed.pressing.any() or attached:
            drive, misfit, doubts = self._estimate(sensed, time_s)
            said += doubts
        elif not sensed.touching.any():
            self.estimator.reset()
        force = drive[: self._split].reshape(len(sensed.touching), -1).sum(axis=1)
        return Tracked(
            time_s,
            np.asarray(sensed.touching),
            np.asarray(sensed.location_m),
            np.where(sensed.touching & ~sensed.pressing, np.nan, force),
            drive[self._split :],
            np.asarray(sensed.reading),
            np.asarray(sensed.sigma),
            misfit,
            sensed.details,
            tuple(said) or (Status.ok,),
            time.perf_counter() - started,
        )

    def _estimate(
        self, sensed: Sensed, time_s: float
    ) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, " k"], list[Status]]:
        weight = np.where(sensed.valid, 1 / sensed.sigma, 0.0)
        clear = bool(sensed.clear)
        reading = sensed.reading if clear else sensed.reading - self._offset.at(self._stroke)
        allowed = np.ones(len(self._upper), bool)
        allowed[: self._split] = self._of_contacts(np.asarray(sensed.pressing))
        upper = np.where(allowed, self._upper, 0.0)
        seen = Observation.on_host(np.asarray(reading), weight, np.asarray(sensed.places))
        found = self.estimator.update(seen, self._limits._replace(upper=upper))
        if found.lost:
            drive = np.where(
                np.arange(len(allowed)) < self._split, np.where(allowed, np.nan, 0.0), found.drive
            )
            return drive, np.full(weight.shape, np.nan), [Status.inverted]
        self._stroke = float(np.linalg.norm((reading - found.misfit)[self._strokes]))
        elapsed = time_s - self._seen_s
        if elapsed > 0:  # not where the time is missing or does not increase
            self._seen_s = time_s
            if clear and not float(found.report.taken) < 1.0:
                share = float(-np.expm1(-elapsed / self.settings.offset_s))
                known = np.asarray(sensed.valid)
                self._offset = self._offset.learned(found.misfit, known, self._stroke, share)
        misfit = np.where(sensed.valid, found.misfit, np.nan)
        return found.drive, misfit, self._doubts(sensed, found, misfit)

    def _of_contacts(self, flags: Bool[np.ndarray, " c"]) -> Bool[np.ndarray, " d"]:
        """A flag of each contact for each of its drives (d,)."""
        return np.repeat(flags, self._split // len(flags))

    def _doubts(self, sensed: Sensed, found: Estimate, misfit: Float[np.ndarray, " k"]) -> list[Status]:
        doubts = []
        # The cells' forces add up to the limit only up to rounding.
        at_limit = found.drive[: self._split] >= self._upper[: self._split] * (1 - 1e-9)
        if np.any(at_limit & self._of_contacts(np.asarray(sensed.pressing))):
            doubts.append(Status.force_limit)
        if found.corrected:
            doubts.append(Status.corrected)
        if float(found.report.taken) < 1.0:
            doubts.append(Status.lagging)
        if _poor(sensed, misfit, self.settings.poor_fit):
            doubts.append(Status.poor_fit)
        if not float(found.report.kkt) <= 1e-6:
            doubts.append(Status.not_optimal)
        return doubts


def _poor(sensed: Sensed, misfit: Float[np.ndarray, " k"], part: float) -> bool:
    """Whether some misfit is beyond both noise and a part of the largest reading, in standard deviations."""
    if not sensed.valid.any():
        return False
    size = np.where(sensed.valid, np.abs(sensed.reading) / sensed.sigma, 0.0)
    missed = np.where(sensed.valid, np.abs(misfit) / sensed.sigma, 0.0)
    return bool(missed.max() > max(part * size.max(), 5.0))
