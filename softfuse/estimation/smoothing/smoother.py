"""Estimates of frames smoothed over time, live (`Smoother`) and of a whole recording (`smoothed_recording`).

A touch begins when something presses and ends when the sensors integrate anew. After it was let go, the body
is at rest again, and what readings say then is their drift: that tells whoever looks back what they had
drifted by while something pressed. Places are followed in the tangent plane of where they were first.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from jaxtyping import Bool, Float

from softfuse.errors import SoftfuseError
from softfuse.estimation.smoothing import place_filter
from softfuse.estimation.smoothing.force_filter import ForceFilter, ForceStep
from softfuse.estimation.smoothing.normal import Normal, smoothed
from softfuse.estimation.smoothing.place_filter import PlaceStep
from softfuse.estimation.smoothing.process import DEFAULT_PROCESS, Process
from softfuse.estimation.tracked import Evidence, Tracked, along_axes
from softfuse.estimation.tracker import Tracker
from softfuse.functional.chart import moved
from softfuse.sensors.zero_drift import ReadingDrift


@dataclass(frozen=True, eq=False)
class Smoothed:
    """What all frames up to one say of it, or all of a touch, of c contacts and k readings.

    `contact_force_N` (c,), 0 where nothing touches, NaN where unknown, with `force_covariance_N2` (c, c), so
    too; `location_m` (c, 3) on the body at rest, NaN where unknown, with `location_sigma_m` (c, 3) along x, y
    and z; `drift` (k,): what readings are off by, in SI, with `drift_sigma` (k,), 0 of those that do not
    drift; `outlier` (k,): readings that were not believed in this frame, `place_outlier` (c,): places.
    """

    time_s: float
    contact_force_N: Float[np.ndarray, " c"]
    force_covariance_N2: Float[np.ndarray, "c c"]
    location_m: Float[np.ndarray, "c 3"]
    location_sigma_m: Float[np.ndarray, "c 3"]
    drift: Float[np.ndarray, " k"]
    drift_sigma: Float[np.ndarray, " k"]
    outlier: Bool[np.ndarray, " k"]
    place_outlier: Bool[np.ndarray, " c"]

    @property
    def contact_sigma_N(self) -> Float[np.ndarray, " c"]:
        """Standard deviation (c,) of each contact's force [N]."""
        return np.sqrt(np.maximum(np.diag(self.force_covariance_N2), 0.0))

    @property
    def force_N(self) -> float:
        """Sum of the contacts' forces [N]."""
        return float(self.contact_force_N.sum())

    @property
    def force_sigma_N(self) -> float:
        """Its standard deviation [N]."""
        return float(np.sqrt(np.maximum(self.force_covariance_N2.sum(), 0.0)))


@dataclass(frozen=True, eq=False)
class _Place:
    """The step of a contact's place, of how far it is along the tangents of a `base` (3, 3)."""

    base: Float[np.ndarray, "3 3"]
    step: PlaceStep


@dataclass(frozen=True, eq=False)
class _TouchFrame:
    """A frame of a touch: its time [s], the step of the forces, and of each contact that of its place."""

    time_s: float
    force: ForceStep
    places: list[_Place | None]


@dataclass
class _Touch:
    """A touch that goes on: all its frames, or where none is kept the last one; the steps of the last
    seconds with their times; the largest reading so far; which readings have said what they are at rest; and
    the largest variances (k,) of their integrals' errors, which grow until these begin anew.
    """

    frames: list[_TouchFrame] = field(default_factory=list)
    recent: deque[tuple[float, ForceStep]] = field(default_factory=deque)
    largest: float = 0.0
    rested: Bool[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(1, bool))
    drifted_V2s2: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(1))


class Smoother:
    """Smooths what a tracker says, frame by frame."""

    def __init__(self, forces: ForceFilter, *, keep: bool):
        """With a filter of forces; `keep` all frames of a touch, for `ended`."""
        self._forces, self._process, self._keep = forces, forces.process, keep
        self.reset()

    @classmethod
    def of(cls, tracker: Tracker, process: Process = DEFAULT_PROCESS, *, keep: bool = False) -> Self:
        """That of a tracker some of whose readings drift, with contacts that go on as a process does.

        Raises SoftfuseError where none drifts: of others a frame tells all there is.
        """
        if tracker.drift is None:
            raise SoftfuseError("none of the readings drifts: there is nothing to smooth")
        return cls(ForceFilter(process, tracker.drift, tracker.adding, tracker.drive_range), keep=keep)

    @property
    def drifting(self) -> Bool[np.ndarray, " k"]:
        """Which readings (k,) drift."""
        return self._forces.drifting

    def reset(self) -> None:
        """Forget the past."""
        self._touch: _Touch | None = None
        self._time_s = np.nan
        self.ended: list[Smoothed] = []
        """Of the touch that ended before the last frame, if frames are kept: what all of it says of each."""

    def update(self, now: Tracked) -> Smoothed:
        """Advance by one frame; never raises for what it contains."""
        dt = self._elapsed(now.time_s)
        self.ended = []
        pressed = bool(now.touching.any())
        if self._touch is not None and now.evidence is not None:
            anew = (_integral_V2s2(now.evidence.drift) < self._touch.drifted_V2s2)[self.drifting]
            if anew.all() or (pressed and anew.any()):
                self.ended = self.finish()
        if self._touch is not None:
            frame = self._next(self._touch, self._touch.frames[-1], dt, now)
        elif pressed and (told := self._told_by(now)) is not None:
            self._touch = _Touch()
            begun = self._forces.begun(told)
            before = _TouchFrame(now.time_s, begun, [None for _ in range(self._forces.contacts)])
            frame = self._next(self._touch, before, 0.0, now)
        else:
            return self._without(now)
        if not self._keep:
            self._touch.frames.clear()
        self._touch.frames.append(frame)
        at = [each and each.step.step.known for each in frame.places]
        return self._smoothed(frame, frame.force.step.known, at)

    def _elapsed(self, time_s: float) -> float:
        """Since the last frame [s]; 0 where the time is missing or does not increase."""
        if not np.isfinite(time_s) or time_s <= self._time_s:
            return 0.0
        elapsed, self._time_s = time_s - self._time_s, time_s
        return elapsed if np.isfinite(elapsed) else 0.0

    def finish(self) -> list[Smoothed]:
        """End the touch that goes on; if frames are kept, what all of it says of each frame."""
        touch, self._touch = self._touch, None
        if touch is None or not self._keep:
            return []
        forces = smoothed([each.force.step for each in touch.frames])
        at: list[list[Normal | None]] = [[None] * self._forces.contacts for _ in touch.frames]
        for c in range(self._forces.contacts):
            steps = [each.places[c] for each in touch.frames]
            for run in _runs(steps):
                found = smoothed([each.step.step for i in run if (each := steps[i])])
                for i, known in zip(run, found, strict=True):
                    at[i][c] = known
        return [self._smoothed(*each) for each in zip(touch.frames, forces, at, strict=True)]

    def _next(self, touch: _Touch, before: _TouchFrame, dt: float, now: Tracked) -> _TouchFrame:
        told, recent = self._told_by(now), touch.recent
        recent.append((self._time_s - dt, before.force))
        if told is None:
            force = self._forces.unknown(before.force, dt)
        else:
            force = self._forces.step(before.force, dt, told, self._anchors(recent, before.force.moved))
        if force.outlier.any():
            # What came before is no measure of what is still any more.
            recent.clear()
        if now.evidence is not None:
            touch.largest = max(touch.largest, float(np.nan_to_num(np.abs(now.reading[self.drifting])).max()))
            force = self._at_rest(touch, now, now.evidence, force)
        places = [self._placed(now, c, dt, each) for c, each in enumerate(before.places)]
        return _TouchFrame(now.time_s, force, places)

    def _anchors(self, recent: deque[tuple[float, ForceStep]], moved: bool) -> list[tuple[float, ForceStep]]:
        """Of recent steps with their times [s], the one since when forces have settled, and the first since
        they have been still, each with how long ago that was [s]; older ones go.
        """
        process, now_s = self._process, self._time_s
        longest = process.settled_s if moved else process.creeping_s
        while len(recent) > 1 and not now_s - recent[1][0] < longest:
            recent.popleft()
        settled = next(
            each for each in recent if not now_s - each[0] > process.settled_s or each is recent[-1]
        )
        return [(now_s - at, step) for at, step in (settled, recent[0]) if np.isfinite(now_s - at)]

    def _at_rest(self, touch: _Touch, now: Tracked, evidence: Evidence, force: ForceStep) -> ForceStep:
        """With what each reading says once, when nothing presses any more."""
        touch.drifted_V2s2 = np.maximum(touch.drifted_V2s2, _integral_V2s2(evidence.drift))
        if now.touching.any():
            touch.rested = np.zeros(self._forces.readings, bool)
            return force
        calm = np.asarray(evidence.drift.calm) & ~touch.rested & np.isfinite(evidence.misfit)
        touch.rested = touch.rested | calm
        known = self._forces.rested(force.step.known, evidence, calm, touch.largest)
        return force._replace(step=force.step._replace(known=known))

    def _placed(self, now: Tracked, c: int, dt: float, before: _Place | None) -> _Place | None:
        if not now.touching[c]:
            return None
        base = now.places[c] if before is None else before.base
        seen, sigma = base[1:] @ (now.location_m[c] - base[0]), now.location_sigma_m[c]
        if before is not None:
            return _Place(base, place_filter.gone_on(self._process, before.step, dt, seen, sigma))
        if not np.isfinite([seen, sigma]).all():
            return None
        return _Place(base, place_filter.begun(self._process, seen, sigma))

    def _told_by(self, now: Tracked) -> Evidence | None:
        """What a frame says of forces: nothing where one presses at an unknown place, and of a body that was
        let go only that nothing presses, as it may still be coming back.
        """
        evidence = now.evidence
        if evidence is None:
            return None
        acting = self._forces.contacts_of(evidence.acting)
        if np.any(now.touching & ~acting):
            return None
        return evidence if acting.any() else replace(evidence, misfit=np.full_like(evidence.misfit, np.nan))

    def _smoothed(self, frame: _TouchFrame, known: Normal, at: list[Normal | None]) -> Smoothed:
        location, sigma = np.full((2, len(at), 3), np.nan)
        for c, (place, each) in enumerate(zip(frame.places, at, strict=True)):
            if place is not None and each is not None:
                offset, spread = place_filter.place(each)
                location[c] = moved(place.base, offset)[0]
                sigma[c] = along_axes(place.base[None], spread[None])[0]
        outlying = np.array([each is not None and each.step.outlier for each in frame.places])
        force, covariance = self._forces.force(known)
        if not frame.force.known:
            force, covariance = np.full_like(force, np.nan), np.full_like(covariance, np.nan)
        drift, drift_sigma = self._forces.drift(known)
        return Smoothed(
            frame.time_s,
            force,
            covariance,
            location,
            sigma,
            drift,
            drift_sigma,
            frame.force.outlier,
            outlying,
        )

    def _without(self, now: Tracked) -> Smoothed:
        """A frame of no touch, or of one of which nothing is known yet."""
        touching, none = now.touching, np.zeros(self._forces.readings)
        force = np.where(touching, np.nan, 0.0)
        location, sigma = (
            np.where(touching[:, None], each, np.nan) for each in (now.location_m, now.axis_sigma_m)
        )
        outlier, outlying = np.zeros(len(none), bool), np.zeros(len(touching), bool)
        return Smoothed(now.time_s, force, np.diag(force), location, sigma, none, none, outlier, outlying)


def smoothed_recording(smoother: Smoother, found: Iterable[Tracked]) -> tuple[list[Smoothed], list[Smoothed]]:
    """Of each frame what those up to it say, and what all of its touch say; `smoother` keeps frames."""
    so_far, whole = list[Smoothed](), list[Smoothed]()
    smoother.reset()
    for now in found:
        so_far.append(smoother.update(now))
        _put_last(whole, smoother.ended)
        whole.append(so_far[-1])
    _put_last(whole, smoother.finish())
    return so_far, whole


def _put_last(whole: list[Smoothed], ended: list[Smoothed]) -> None:
    whole[len(whole) - len(ended) :] = ended


def _integral_V2s2(drift: ReadingDrift) -> Float[np.ndarray, " k"]:
    """Variances (k,) [V² s²] of the integrals' errors."""
    return np.asarray(drift.covariance)[:, 2, 2]


def _runs(steps: list[_Place | None]) -> list[range]:
    """Where there are steps without a break."""
    edges = np.flatnonzero(np.diff([0, *(int(each is not None) for each in steps), 0]))
    return [range(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
