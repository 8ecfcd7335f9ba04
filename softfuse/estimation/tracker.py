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
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from softfuse.estimation.compiled_senses import CompiledSenses, Finding
from softfuse.estimation.estimator import DEFAULT_STEPS, Estimate, Estimator, StepSettings
from softfuse.estimation.limits import Limits
from softfuse.estimation.model_error import AS_DRAWN, ModelError, whitening
from softfuse.estimation.model_offset import ModelOffset
from softfuse.estimation.place_search import Placed, PlaceSearch, as_seen, unseen
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.estimation.step import Observation
from softfuse.estimation.tracked import Evidence, Frame, Tracked, along
from softfuse.functional.workspace import AbstractWorkspace
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.rom.atlas import Atlas
from softfuse.sensors.senses import AbstractSenses, Sensed
from softfuse.sensors.status import Status

_AT_LEISURE_S = 2.0
"""After so long there is time to make ready what most touches do without."""


@dataclass(frozen=True)
class TrackerSettings:
    """When an estimate is doubted: `poor_fit` [-], a misfit above this part of the largest reading;
    `model_error`, by how much the model may be wrong; `offset_s` [s], over which time what the model misses
    is averaged.
    """

    poor_fit: float = 0.25
    model_error: ModelError = ModelError()
    offset_s: float = 1.0


class _Estimated(NamedTuple):
    """Drives (D,), covariance (m, m) of these and of places, where contacts press and are, measured minus
    modelled readings (k,), what these say by themselves, and what is doubted.
    """

    drive: Float[np.ndarray, " D"]
    covariance: Float[np.ndarray, "m m"]
    places: np.ndarray
    placed: Placed
    misfit: Float[np.ndarray, " k"]
    evidence: Evidence | None
    doubts: list[Status]


def posterior_covariance(found: Estimate, limits: Limits) -> Float[np.ndarray, "DP DP"]:
    """Covariance (D + P, D + P) of the drives of an estimate and of the numbers η of places that were not
    known, of those within their limits the inverse of their information.

    A drive that is held at a limit has the variance that it would have alone, if it could move: by so much
    the readings let it be wrong; one that has no room has none.
    """
    lower, upper = np.asarray(limits.lower), np.asarray(limits.upper)
    information, room = found.report.information, 1e-9 * (upper - lower)
    places = np.ones(len(information) - len(upper), bool)
    movable = upper > lower
    within = movable & (found.drive > lower + room) & (found.drive < upper - room)
    free = np.append(within, places)
    alone = np.where(np.append(movable & ~within, ~places), 1 / np.diag(information), 0.0)
    covariance = np.diag(alone)
    covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
    return covariance


class Tracker:
    """Follows the contacts on a device through the frames of its sensors; compiled when made."""

    def __init__(
        self,
        senses: AbstractSenses,
        device: Model | Atlas,
        limits: Limits,
        settings: TrackerSettings = TrackerSettings(),
        steps: StepSettings = DEFAULT_STEPS,
        *,
        workspace: AbstractWorkspace | None = None,
    ):
        """Compile senses and estimate step, of the device or of its charts; readings tell the places of
        contacts within a `workspace`, without one these are where they are seen.

        Raises SolveError when the body cannot be estimated or the limits do not fit, see `Estimator`; and
        SoftfuseError for a chart that cannot be read.
        """
        self.settings = settings
        started = time.perf_counter()
        with ThreadPoolExecutor(1) as aside:
            self._senses = CompiledSenses(senses, aside)
            places = self._senses.places
            known = workspace is None
            self.estimator: Estimator | ReducedEstimator
            if isinstance(device, Atlas):
                self.estimator = ReducedEstimator(device, limits, places, steps, places_known=known)
            else:
                self.estimator = Estimator(device, limits, places, steps, places_known=known)
        self._search = None if workspace is None else PlaceSearch(device, workspace, places.shape[0])
        self._misses = self._search is not None and senses.misses
        device = self.estimator.device
        self.compile_s = time.perf_counter() - started
        self._limits, self._upper = limits, np.asarray(limits.upper)
        self.adding = device.adding(places.shape[0])
        self._split = self.adding.shape[1]
        """(c, F): a contact's forces together, the sum over its drives, which are the first F."""
        self.drift = senses.drift
        """How readings drift while something presses; None where they do not."""
        free = self._upper[self._split :] > np.asarray(limits.lower)[self._split :]
        answered = device.answered
        self._strokes = np.flatnonzero((answered >= 0) & np.append(free, False)[answered])
        self.reset()

    @property
    def drive_range(self) -> Float[np.ndarray, " D"]:
        """How far drives (D,) may go, in their units."""
        return self._upper - np.asarray(self._limits.lower)

    @property
    def state(self) -> State:
        """The body and its loads after the last frame; `device.body.displacement(z)` is the shape."""
        return self.estimator.state

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._senses.reset()
        self._stroke, self._seen_s, self._begun_s = 0.0, -np.inf, np.inf
        self._offset = ModelOffset.none(self.estimator.device.n_readings)
        self._force_N = np.zeros(len(self.adding))
        if self._search is not None:
            self._search.reset()
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
        found = self._nothing(sensed)
        if not sensed.touching.any():
            said.insert(0, Status.no_contact)
        if self._search is not None and self._misses:
            self._begun_s = min(self._begun_s, time_s)
            if time_s - self._begun_s > _AT_LEISURE_S:
                self._search.prepare()
        if sensed.pressing.any() or attached:
            found = self._estimate(sensed, time_s)
            said += found.doubts
        elif not sensed.touching.any():
            self.estimator.reset()
        force = self.adding @ found.drive[: self._split]
        covariance = self.adding @ found.covariance[: self._split, : self._split] @ self.adding.T
        covariance = covariance + np.diag(found.placed.elsewhere_N2)
        unknown = np.asarray(sensed.touching & ~sensed.pressing)
        self._force_N = np.nan_to_num(force)
        return Tracked(
            time_s,
            np.asarray(sensed.touching),
            found.placed.location_m,
            found.placed.sigma_m,
            np.where(unknown, np.nan, force),
            np.where(unknown[:, None] | unknown, np.nan, covariance),
            found.places,
            found.covariance,
            found.drive[self._split :],
            np.asarray(sensed.reading),
            np.asarray(sensed.sigma),
            found.misfit,
            found.evidence,
            sensed.details,
            tuple(said) or (Status.ok,),
            time.perf_counter() - started,
        )

    def _estimate(self, sensed: Sensed, time_s: float) -> _Estimated:
        clear, valid = bool(sensed.clear), np.asarray(sensed.valid)
        reading = np.asarray(sensed.reading if clear else sensed.reading - self._offset.at(self._stroke))
        allowed = np.ones(len(self._upper), bool)
        allowed[: self._split] = self._of_contacts(np.asarray(sensed.pressing))
        limits = self._limits._replace(upper=np.where(allowed, self._upper, 0.0))
        search, places, prior = self._search, np.asarray(sensed.places), None
        if search is not None and search.sought:
            places = search.taken(sensed)
        uncertain = self._model_error(sensed).covariance(
            np.where(valid, reading, 0.0), np.asarray(sensed.sigma), places, self._force_N
        )
        if search is not None:
            if search.seek(sensed, self._told(sensed), self._force_N, reading, uncertain):
                self.estimator.reset()
            if search.sought:
                places, prior = search.taken(sensed), search.prior(sensed)
        seen = Observation.on_host(reading, whitening(uncertain, valid), places, prior)
        found = self.estimator.update(seen, limits)
        if found.lost:
            if search is not None:
                search.reset()
            unknown = allowed & (np.arange(len(allowed)) < self._split)
            drive = np.where(unknown, np.nan, np.where(allowed, found.drive, 0.0))
            nothing = np.where(unknown[:, None] | unknown, np.nan, 0.0)
            lost = self._nothing(sensed)
            return lost._replace(drive=drive, covariance=nothing, evidence=None, doubts=[Status.inverted])
        self._stroke = float(np.linalg.norm((reading - found.misfit)[self._strokes]))
        elapsed = time_s - self._seen_s
        if elapsed > 0:  # not where the time is missing or does not increase
            self._seen_s = time_s
            if clear and not float(found.report.taken) < 1.0:
                share = float(-np.expm1(-elapsed / self.settings.offset_s))
                self._offset = self._offset.learned(found.misfit, valid, self._stroke, share)
        misfit = np.where(valid, found.misfit, np.nan)
        doubts = self._doubts(sensed, np.sqrt(np.diag(uncertain)), found, misfit)
        covariance, placed = posterior_covariance(found, limits), as_seen(sensed)
        drives = len(self._upper)
        if search is not None and prior is not None:
            spread = np.asarray(prior.spread)
            scale = np.eye(len(covariance))
            scale[drives:, drives:] = spread
            covariance = scale @ covariance @ scale.T
            force = self.adding @ found.drive[: self._split]
            told = covariance[drives:, drives:]
            placed = search.found(sensed, np.asarray(found.report.offset), told, force)
            places = search.taken(sensed)
        if search is not None:
            # Places that the readings did not tell are as sure as they were seen.
            told = np.diagonal(covariance)[drives:]
            unmoved = np.ones(told.shape, bool) if prior is None else np.diag(prior.spread) == 0
            at = drives + np.flatnonzero(unmoved)
            covariance[at, at] = placed.variance_m2[unmoved]
        evidence = None
        if sensed.drift is not None and not unseen(sensed).any():
            lasting = self.settings.model_error.lasting(
                np.where(valid, reading, 0.0), np.asarray(sensed.sigma), places, self._force_N
            )
            acting = np.asarray(limits.upper > limits.lower)
            compliance = np.asarray(found.report.compliance)
            evidence = Evidence(
                misfit,
                found.drive,
                compliance,
                along(places, places[:, 0]),
                np.asarray(found.report.by_place),
                along(places, np.asarray(sensed.location_m)),
                np.asarray(sensed.location_sigma_m).ravel(),
                acting,
                lasting,
                sensed.drift,
            )
        return _Estimated(found.drive, covariance, places, placed, misfit, evidence, doubts)

    def _nothing(self, sensed: Sensed) -> _Estimated:
        """Nothing that presses."""
        drives = len(self._upper)
        unexplained = np.full(np.shape(sensed.reading), np.nan)
        places, still = np.asarray(sensed.places), np.zeros((drives, drives))
        evidence = None
        if sensed.drift is not None:
            reading = np.where(sensed.valid, sensed.reading, np.nan)
            evidence = Evidence.of_rest(reading, drives, len(places), sensed.drift)
        return _Estimated(np.zeros(drives), still, places, as_seen(sensed), unexplained, evidence, [])

    def _model_error(self, sensed: Sensed) -> ModelError:
        """By how much the model may be wrong; where only readings tell of a contact, never by nothing."""
        given = self.settings.model_error
        return AS_DRAWN if given.part == 0 and self._search and unseen(sensed).any() else given

    def _told(self, sensed: Sensed) -> Bool[np.ndarray, " c"]:
        """Contacts (c,) whose places readings tell: of a model about whose errors nothing is known, only of
        those that nothing else sees.
        """
        return unseen(sensed) | (self.settings.model_error.part > 0)

    def _of_contacts(self, flags: Bool[np.ndarray, " c"]) -> Bool[np.ndarray, " d"]:
        """A flag of each contact for each of its drives (d,)."""
        return flags @ self.adding > 0

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
