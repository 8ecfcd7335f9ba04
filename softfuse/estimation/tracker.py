"""Sensor frames in, contacts, forces and shape out: a robot's sensors and the estimator, frame after frame.

The sensors decide what touches and where; each frame's readings drive one estimate step, in which only those
contacts may press that touch. What no sensor sees is told by readings that nothing else explains
(`unseen_touch`). While nothing touches a robot without actuators, its body is taken to rest. What the
model misses while nothing is near is taken off the readings of the touch that follows (`model_error`). What
cannot be trusted gets a status, and a number that would be a guess is NaN. Nothing here is threaded, but for
compiling, or reads files; `hardware` does that.
"""

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from softfuse.errors import ConfigError
from softfuse.estimation.bounds import limits_of, step_settings
from softfuse.estimation.compiled_suite import CompiledSuite, Finding
from softfuse.estimation.doubts import TrackerSettings, doubts_of
from softfuse.estimation.estimator import Estimate, Estimator
from softfuse.estimation.limits import Limits
from softfuse.estimation.model_error import ModelError, ModelOffset, assumed, lasting, whitening
from softfuse.estimation.place_search import Placed, PlaceSearch, Seen, as_seen
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.estimation.step import Observation as Aim
from softfuse.estimation.tracked import Evidence, Frame, Tracked, along
from softfuse.estimation.uncertainty import posterior_covariance
from softfuse.estimation.unseen_touch import UnseenTouch
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.robot.robot import Robot
from softfuse.rom.rom_file import Atlas
from softfuse.sensors.status import Status
from softfuse.sensors.suite import Observation

_AT_LEISURE_S = 2.0
"""After so long there is time to make ready what most touches do without."""

_KINDS: Mapping[type, Callable[..., Estimator | ReducedEstimator]]
_KINDS = {Model: Estimator, Atlas: ReducedEstimator}
"""Estimators by what they estimate with."""


class _Estimated(NamedTuple):
    """Drives (D,), covariance (m, m) of these and of places, where contacts press and are, measured minus
    modelled readings (k,), what these say by themselves, and what is doubted.
    """

    drive: Float[np.ndarray, " D"]
    covariance: Float[np.ndarray, "m m"]
    places: Float[np.ndarray, "c 3 3"]
    placed: Placed
    misfit: Float[np.ndarray, " k"]
    evidence: Evidence | None
    doubts: list[str]


class Tracker:
    """Follows the contacts on a robot through the frames of its sensors; compiled when made."""

    def __init__(
        self,
        robot: Robot,
        model: Model | Atlas | None = None,
        settings: TrackerSettings | None = None,
    ):
        """Compile sensors and estimate step, of the robot's model or of another, such as its reduced ones.

        Raises ConfigError when nothing tells of a contact, SolveError when the body cannot be estimated, and
        SoftfuseError for a reduced model that cannot be read.
        """
        self.robot, self.settings = robot, TrackerSettings.of(robot) if settings is None else settings
        model = robot.model if model is None else model
        started = time.perf_counter()
        limits, steps = limits_of(robot), step_settings(robot)
        count = len(robot.workspaces)
        self._check()
        # A frame of any place will do to compile for.
        waiting = [part.somewhere for part in robot.parts.contacts.values() for _ in range(part.slots)]
        places = jnp.asarray(np.reshape(waiting, (-1, 3, 3)))
        known = all(workspace is None for workspace in robot.workspaces)
        with ThreadPoolExecutor(1) as aside:
            self._suite = CompiledSuite(robot.suite, aside)
            self.estimator = _KINDS[type(model)](model, limits, places, steps, places_known=known)
        self._search = None if known else PlaceSearch(robot.workspaces)
        self._misses = self._search is not None and (robot.suite.misses or robot.unseen.any())
        self.compile_s = time.perf_counter() - started
        self._limits, self._upper = limits, np.asarray(limits.upper)
        self._lower = np.asarray(limits.lower)
        self.adding = self.estimator.model.adding(count)
        """(c, F): a contact's forces along its normal together, of its drives, which are the first F."""
        self._owning = self.estimator.model.owning(count)
        self._split = self.adding.shape[1]
        self._unseen = UnseenTouch(robot, self.estimator, self.drive_range[self._split :])
        self.drift = robot.suite.drift
        """How readings drift while something presses; None where they do not."""
        free = self._upper[self._split :] > self._lower[self._split :]
        answered = self.estimator.model.answered
        self._strokes = np.flatnonzero((answered >= 0) & np.append(free, False)[answered])
        self._commanded = np.array([command.drive for command in robot.commands], int) + self._split
        self._of_answer = np.array([command.of_answer for command in robot.commands], bool)
        self._factor = np.array([command.factor for command in robot.commands])
        self.reset()

    def _check(self) -> None:
        for name, slots in self.robot.addresses.slots.items():
            if self.robot.unseen[slots].any() and self.robot.workspaces[slots.start] is None:
                raise ConfigError(
                    f'{self.robot.settings.path}: contact "{name}": no sensor sees it, and it has no surface '
                    "on which readings could find it: add a sensor with this contact, or surface = {}"
                )

    @property
    def drive_range(self) -> Float[np.ndarray, " D"]:
        """How far drives (D,) may go, in their units."""
        return self._upper - self._lower

    @property
    def state(self) -> State:
        """The body and its loads after the last frame; `model.body.displacement(z)` is the shape."""
        return self.estimator.state

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._suite.reset()
        self._stroke, self._seen_s, self._begun_s = 0.0, -np.inf, np.inf
        readings = self.estimator.model.n_readings
        self._offset = ModelOffset.none(readings)
        self._force_N = np.zeros(len(self.adding))
        self._unseen.reset()
        self._command = np.zeros(len(self._commanded))
        if self._search is not None:
            self._search.reset()
        self.estimator.reset()

    def update(self, frame: Frame) -> Tracked:
        """Advance by one frame; never raises for what its readings are, only for their number."""
        started = time.perf_counter()
        found = self.estimate(frame.time_s, self.sense(frame))
        return replace(found, latency_s=time.perf_counter() - started)

    def sense(self, frame: Frame) -> Finding:
        """Advance the sensors by one frame, without estimating: what it says, not yet read.

        Sensors integrate, average and debounce, so that they want every frame, also where forces and shape
        are estimated from fewer.
        """
        raw = np.asarray(frame.raw)
        if len(self._commanded):
            raw, command = np.split(raw, [len(raw) - len(self._commanded)])
            # One that is missing stays what it was.
            self._command = np.where(np.isfinite(command), command * self._factor, self._command)
        return self._suite.update(frame.time_s, raw)

    def estimate(self, time_s: float, finding: Finding) -> Tracked:
        """Forces and shape from what the sensors said last, at `time_s` [s]."""
        started = time.perf_counter()
        now = finding.observation
        said: list[str] = [status for status, true in now.flags.items() if true]
        seen = self._seen(now)
        touching = np.asarray(now.touching) | (seen.pressing & seen.unseen)
        attached = len(self._upper) - self._split
        found = self._nothing(now, seen)
        if not touching.any():
            said.insert(0, Status.no_contact)
        if self._misses:
            self._begun_s = min(self._begun_s, time_s)
            if time_s - self._begun_s > _AT_LEISURE_S:
                self._unseen.prepare()
        if seen.pressing.any() or attached or self._unseen.alone:
            found = self._estimate(now, seen, time_s)
            said += found.doubts
        elif not touching.any():
            self.estimator.reset()
        force = self.adding @ found.drive[: self._split]
        covariance = self.adding @ found.covariance[: self._split, : self._split] @ self.adding.T
        covariance = covariance + np.diag(found.placed.elsewhere_N2)
        unknown = touching & ~seen.pressing
        self._force_N = np.nan_to_num(force)
        self._follow_unseen(seen, covariance)
        return Tracked(
            time_s,
            touching,
            found.placed.location_m,
            found.placed.sigma_m,
            np.where(unknown, np.nan, force),
            np.where(unknown[:, None] | unknown, np.nan, covariance),
            found.places,
            found.covariance,
            found.drive[self._split :],
            np.asarray(now.reading),
            np.asarray(now.sigma),
            np.asarray(now.valid),
            found.misfit,
            found.evidence,
            now.details,
            tuple(said) or (Status.ok,),
            time.perf_counter() - started,
        )

    def _seen(self, now: Observation) -> Seen:
        """What is known of the contacts before the readings tell."""
        pressing = np.array(now.pressing)
        location, sigma = np.array(now.location_m), np.array(now.location_sigma_m)
        unseen = pressing & np.isnan(location).any(axis=1)
        if self._unseen.touching:
            pressing[self._unseen.slot] = unseen[self._unseen.slot] = True
        for c in np.flatnonzero(unseen):
            workspace = self.robot.workspaces[c]
            if not np.isfinite(sigma[c]).all() and workspace is not None:
                sigma[c] = workspace.extent_m
        return Seen(pressing, unseen, np.array(now.places), location, sigma)

    def _follow_unseen(self, seen: Seen, covariance: Float[np.ndarray, "c c"]) -> None:
        """Whether what readings alone tell of has begun or gone."""
        if self._unseen.alone:
            c, pressed = self._unseen.slot, bool(self._force_N.any())
            sigma = float(np.sqrt(covariance[c, c]))
            self._unseen.follow(self._force_N[c], sigma, seen=bool(seen.pressing[c]), pressed=pressed)

    def _limits_now(self, pressing: Bool[np.ndarray, " c"]) -> Limits:
        """The limits in a frame: only contacts that press have a force, what is commanded is known."""
        lower, upper = self._lower.copy(), self._upper.copy()
        for end in (lower, upper):
            end[: self._split][~self._of_contacts(pressing)] = 0.0
        limits = self._limits
        by_drive = ~self._of_answer
        at = self._commanded[by_drive]
        lower[at] = upper[at] = self._command[by_drive]
        if limits.strokes is not None:
            low, high = (np.array(each) for each in limits.strokes)
            at = self._commanded[self._of_answer]
            low[at] = high[at] = self._command[self._of_answer]
            limits = limits._replace(strokes=(low, high))
        return limits._replace(lower=lower, upper=upper)

    def _estimate(self, now: Observation, seen: Seen, time_s: float) -> _Estimated:
        clear, valid = bool(now.clear) and not self._unseen.touching, np.asarray(now.valid)
        # What is taken for a model's error where no sensor sees contacts may be a contact.
        learns = clear and not self._unseen.alone
        reading = np.asarray(now.reading if learns else now.reading - self._offset.at(self._stroke))
        limits = self._limits_now(seen.pressing)
        allowed = np.asarray(limits.upper) > 0
        search, places, prior = self._search, seen.places, None
        if search is not None and search.sought:
            places = search.taken(seen)
        error, sigma = self._model_error(seen), np.asarray(now.sigma)
        known = np.where(valid, reading, 0.0)
        uncertain = error.covariance(known, sigma, places, self._force_N)
        self._unseen.read(reading, valid, sigma, error, uncertain)
        if search is not None:
            lone = seen.pressing.sum() == 1 and bool((seen.pressing & seen.unseen).any())
            fit = self._unseen.fit(fresh=not self._force_N.any()) if lone else None
            if search.seek(seen, self._told(seen), self._force_N, fit):
                # A force that jumps along a slender body would throw it further than a step can follow.
                self.estimator.go_back()
            if search.sought:
                places, prior = search.taken(seen), search.prior(seen)
        aim = Aim.on_host(reading, whitening(uncertain, valid), places, prior)
        found = self.estimator.update(aim, limits)
        if found.lost:
            if search is not None:
                search.reset()
            self._unseen.lose()
            unknown = allowed & (np.arange(len(allowed)) < self._split)
            drive = np.where(unknown, np.nan, np.where(allowed, found.drive, 0.0))
            nothing = np.where(unknown[:, None] | unknown, np.nan, 0.0)
            lost = self._nothing(now, seen)
            return lost._replace(drive=drive, covariance=nothing, evidence=None, doubts=[Status.inverted])
        if not (seen.pressing.any() or np.any(now.touching)):
            self.estimator.keep()
        self._stroke = float(np.linalg.norm((reading - found.misfit)[self._strokes]))
        self._unseen.model(reading - found.misfit, found, self._split)
        elapsed = time_s - self._seen_s
        if elapsed > 0:  # not where the time is missing or does not increase
            self._seen_s = time_s
            if learns and not float(found.report.taken) < 1.0:
                share = float(-np.expm1(-elapsed / self.settings.offset_s))
                self._offset = self._offset.learned(found.misfit, valid, self._stroke, share)
        misfit = np.where(valid, found.misfit, np.nan)
        doubts = self._doubts(now, seen, np.sqrt(np.diag(uncertain)), found, misfit)
        covariance, placed = posterior_covariance(found, limits), as_seen(seen)
        drives = len(self._upper)
        if search is not None and prior is not None:
            spread = np.asarray(prior.spread)
            scale = np.eye(len(covariance))
            scale[drives:, drives:] = spread
            covariance = scale @ covariance @ scale.T
            force = self.adding @ found.drive[: self._split]
            told = covariance[drives:, drives:]
            placed, places = search.found(seen, np.asarray(found.report.offset), told, force)
            if placed.ambiguous.any():
                doubts.append(Status.ambiguous)
        if search is not None:
            # Places that the readings did not tell are as sure as they were seen.
            told = np.diagonal(covariance)[drives:]
            unmoved = np.ones(told.shape, bool) if prior is None else np.diag(prior.spread) == 0
            at = drives + np.flatnonzero(unmoved)
            covariance[at, at] = placed.variance_m2[unmoved]
        evidence = None
        if now.drift is not None and not seen.unseen.any():
            unchanged = lasting(self.settings.model_error, known, sigma, places, self._force_N)
            acting = np.asarray(limits.upper > limits.lower)
            evidence = Evidence(
                misfit,
                sigma,
                found.drive,
                np.asarray(found.report.compliance),
                along(places, places[:, 0]),
                np.asarray(found.report.by_place),
                along(places, seen.location_m),
                seen.sigma_m.ravel(),
                acting,
                unchanged,
                now.drift,
            )
        return _Estimated(found.drive, covariance, places, placed, misfit, evidence, doubts)

    def _nothing(self, now: Observation, seen: Seen) -> _Estimated:
        """Nothing that presses."""
        drives = len(self._upper)
        unexplained = np.full(np.shape(now.reading), np.nan)
        evidence = None
        if now.drift is not None:
            reading = np.where(now.valid, now.reading, np.nan)
            evidence = Evidence.of_rest(reading, np.asarray(now.sigma), drives, len(seen.places), now.drift)
        still = np.zeros((drives, drives))
        return _Estimated(np.zeros(drives), still, seen.places, as_seen(seen), unexplained, evidence, [])

    def _model_error(self, seen: Seen) -> ModelError:
        """By how much the model may be wrong."""
        alone = self._search is not None and (bool(seen.unseen.any()) or self._unseen.alone)
        return assumed(self.settings.model_error, self.robot.reading_kinds, alone=alone)

    def _told(self, seen: Seen) -> Bool[np.ndarray, " c"]:
        """Contacts (c,) whose places readings tell: unseen ones, and all where the model's error is known."""
        return seen.unseen | (self.settings.model_error is not None)

    def _of_contacts(self, flags: Bool[np.ndarray, " c"]) -> Bool[np.ndarray, " d"]:
        """A flag of each contact for each of its drives (d,)."""
        return flags @ self._owning > 0

    def _doubts(
        self,
        now: Observation,
        seen: Seen,
        sigma: Float[np.ndarray, " k"],
        found: Estimate,
        misfit: Float[np.ndarray, " k"],
    ) -> list[str]:
        doubts: list[str] = []
        # The cells' forces add up to the limit only up to rounding.
        at_limit = found.drive[: self._split] >= self._upper[: self._split] * (1 - 1e-9)
        if np.any(at_limit & self._of_contacts(seen.pressing)):
            doubts.append(Status.force_limit)
        return doubts + doubts_of(now, sigma, found, misfit, self.settings.poor_fit)
