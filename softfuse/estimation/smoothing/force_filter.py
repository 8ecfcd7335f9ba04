"""Forces and sensors' drift from one frame to the next.

State x = (u, p, b, m, δ): drives u (D,), places p (P,) along the tangents of each contact, by how much what
sees these is off b (P,), what the model misses of each of k readings m (k,), and what each sensor drifts by,
δ (3,), see `sensors.zero_drift`. A frame, and what sees contacts at p̂, say

    y − s(u₀, p₀) + W u₀ + G p₀ = W u + G p + m + diag(ρ) δ₃ + v,    p̂ = p + b + w.

δ goes on as the zero of a sensor does. While forces are still, u and p walk slowly at random, m and b stay,
so that what readings show besides is drift. Where a frame contradicts that, forces have moved: u and p may be
anything, and of m and b as much is new as readings have changed and contacts have gone since. They and drift
are not learnt from such frames, in which the model lags behind: so each error tells of drift once, however
often forces move, and none is averaged away. Where a frame contradicts that as well, but only in one reading,
this is an outlier: what was integrated is off by as much from there on. W and G change only as forces move,
lest their jitter tell u from m.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from softfuse.estimation.smoothing.normal import Change, Normal, Reading, Step
from softfuse.estimation.smoothing.process import Process
from softfuse.estimation.tracked import Evidence
from softfuse.sensors.zero_drift import DriftModel

_UNIT_V = 1e-3
"""Of δ in the state: drifts are some millivolts."""

_SHORTEST_S = 1e-3
"""Between readings: no reading is without noise."""

_ANY = 100.0
"""Of a range: standard deviation of drives that may be anything, as good as infinite."""

_UNITS = 10.0
"""In the state, of the range of an actuator's drive."""

_UNIT_M = 1e-4
"""Of places in the state."""

_CERTAIN = 1e-2
"""Of noise, of the unit of places: no standard deviation is smaller."""

_ANYWHERE_M = 0.1
"""Standard deviation of places that may be anywhere."""


class ForceStep(NamedTuple):
    """A frame's step, which readings (k,) were outliers, the evidence when forces moved last, which drives
    (D,) act, whether they moved, and whether forces are known.
    """

    step: Step
    outlier: Bool[np.ndarray, " k"]
    since: Evidence
    acting: Bool[np.ndarray, " D"]
    moved: bool = False
    known: bool = True


class ForceFilter:
    """Filters the frames of a touch, of c contacts and k readings, some of which drift."""

    def __init__(
        self,
        process: Process,
        drift: DriftModel,
        adding: Float[np.ndarray, "c F"],
        range_: Float[np.ndarray, " D"],
    ):
        """For k readings that drift so; `adding` (c, F): sums of a contact's drives, which are the first F of
        D; `range_` (D,): how far drives go, in a second what is attached may go as far.
        """
        self.process, self._drift, self._adding = process, drift, adding
        self._effect = np.asarray(drift.effect) * _UNIT_V
        self.drifting = self._effect != 0
        self.readings, self.contacts = len(self._effect), len(adding)
        self._drives, self._forces = len(range_), adding.shape[1]
        self._drive_unit = np.where(np.arange(self._drives) < self._forces, 1.0, range_ / _UNITS)
        self._drive_unit[self._drive_unit == 0] = 1.0
        self._range = range_ / self._drive_unit
        numbers = 2 * self.contacts, 2 * self.contacts, self.readings, 3 * self.readings
        ends = self._drives + np.cumsum([0, *numbers])
        self._places, self._off, self._missed, self._drifts = map(slice, ends[:-1], ends[1:])
        self._size, self._lasting = int(ends[-1]), slice(self._off.start, None)
        self._any = _ANY * self._range
        self._unit = np.abs(self._effect)
        self._integral = self._drifts.start + 2 + 3 * np.arange(self.readings)
        drift.step(_SHORTEST_S, _SHORTEST_S)  # compiled here, not while the first contact waits for it

    def begun(self, evidence: Evidence) -> ForceStep:
        """Before the first frame, which says this: nothing presses."""
        # Of the model's error in readings that do not drift.
        self._unit = np.where(self.drifting, np.abs(self._effect), _positive(evidence.sigma))
        covariance = np.zeros((self._size, self._size))
        for at, own in zip(self._integral, np.asarray(evidence.drift.covariance), strict=True):
            covariance[at - 2 : at + 1, at - 2 : at + 1] = own / _UNIT_V**2
        begun = Normal(np.zeros(self._size), covariance)
        none = Change(np.eye(self._size), np.zeros_like(covariance))
        nothing = replace(evidence, drive=np.zeros(self._drives))
        calm, idle = np.zeros(self.readings, bool), np.zeros(self._drives, bool)
        return ForceStep(Step(none, begun, begun), calm, nothing, idle)

    def step(
        self,
        before: ForceStep,
        dt_s: float,
        evidence: Evidence,
        anchors: Iterable[tuple[float, ForceStep]],
    ) -> ForceStep:
        """The next frame, dt_s [s] later, with what it says.

        Forces are still if that contradicts neither the frame before nor earlier ones, `anchors` so long [s]
        ago, and no drive acts that did not.
        """
        known, outlier = before.step.known, np.zeros(self.readings, bool)
        acting, since = evidence.acting, before.since
        reading, change = self._reading(evidence, since), self._still(dt_s, evidence)
        begins = bool(np.any(acting & ~before.acting))
        moved = (
            begins
            or self._surprising(known, change, reading)
            or any(self._contradicted(step, since_s, evidence) for since_s, step in anchors)
        )
        if moved:
            anew, free = self._reading(evidence, evidence), self._moved(dt_s, evidence, since)
            if self._surprising(known, free, anew):
                if not begins:
                    outlier = self._outlier(known, change, reading, acting)
                moved = not outlier.any()
                if moved:
                    outlier = self._outlier(known, free, anew, acting)
            if moved:
                change, reading, since = free, anew, evidence
            if np.any(outlier & self.drifting):
                change = self._jumped(outlier & self.drifting, known, change, reading)
            reading.value[: self.readings][outlier & ~self.drifting] = np.nan
        later = known.gone_on(change)
        told = later.updated(_known(reading), considered=self._lasting if moved else slice(0))
        return ForceStep(Step(change, later, told), outlier, since, acting, moved)

    def unknown(self, before: ForceStep, dt_s: float) -> ForceStep:
        """The next frame, dt_s [s] later, in which nothing is known of forces."""
        none = np.zeros(self._drives, bool)
        change = self._changed(dt_s, max(dt_s, _SHORTEST_S), none, self._any)
        self._relocated(change)
        later = before.step.known.gone_on(change)
        no = np.zeros(self.readings, bool)
        return ForceStep(Step(change, later, later), no, before.since, none, moved=True, known=False)

    def rested(
        self, known: Normal, evidence: Evidence, calm: Bool[np.ndarray, " k"], largest: float
    ) -> Normal:
        """With what readings say that are calm (k,), as the body is at rest again after readings of up to
        `largest`.
        """
        reading, own = self._reading(evidence, evidence), np.arange(self.readings)
        rows = np.where(np.arange(self._size) < self._drifts.start, 0.0, reading.rows)[own]
        sigma = np.hypot(reading.sigma[own], self.process.creep * largest)
        at_rest = Reading(reading.value[own], rows, sigma)
        # What is far from any drift is no rest: something still presses that is not seen.
        credible = [
            bool(calm[k]) and not self.process.surprising(known.surprise(at_rest.only(own == k)), 1)
            for k in own
        ]
        return known.updated(at_rest.only(np.array(credible))) if any(credible) else known

    def force(self, known: Normal) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, "c c"]]:
        """Forces (c,) [N] of contacts, none of which pulls, and their covariance (c, c)."""
        forces = slice(self._forces)
        mean = self._adding @ known.mean[forces]
        covariance = self._adding @ known.covariance[forces, forces] @ self._adding.T
        return np.maximum(mean, 0.0), covariance

    def contacts_of(self, acting: Bool[np.ndarray, " D"]) -> Bool[np.ndarray, " c"]:
        """Contacts (c,) of which a drive acts."""
        return self._adding @ acting[: self._forces] > 0

    def drift(self, known: Normal) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """What readings (k,) are off by, in SI, and the standard deviations of that."""
        variance = np.maximum(np.diag(known.covariance)[self._integral], 0.0)
        return self._effect * known.mean[self._integral], np.abs(self._effect) * np.sqrt(variance)

    def _contradicted(self, anchor: ForceStep, since_s: float, evidence: Evidence) -> bool:
        """Whether forces cannot have been still for so long [s]."""
        reading = self._reading(evidence, anchor.since)
        return self._surprising(anchor.step.known, self._still(since_s, evidence), reading)

    def _surprising(self, known: Normal, change: Change, reading: Reading) -> bool:
        """Whether readings contradict a change."""
        reading = _known(reading)
        numbers = len(reading.value)
        surprise = known.gone_on(change).surprise(reading)
        return numbers > 0 and self.process.surprising(surprise, numbers)

    def _changed(
        self,
        dt_s: float,
        period_s: float,
        acting: Bool[np.ndarray, " D"],
        walk: Float[np.ndarray, " D"],
    ) -> Change:
        """Of drives that act or not and walk by (D,), and of drifts; all else stays."""
        transition, noise = np.eye(self._size), np.zeros((self._size, self._size))
        drives = np.arange(self._drives)
        transition[drives, drives] = acting
        noise[drives, drives] = np.where(acting, walk**2, 0.0)
        own, chance = self._drift.step(dt_s, period_s)
        transition[self._drifts, self._drifts] = block_diag(*own)
        noise[self._drifts, self._drifts] = block_diag(*chance) / _UNIT_V**2
        return Change(transition, noise)

    def _still(self, dt_s: float, evidence: Evidence) -> Change:
        """Of forces that hardly move."""
        walk = np.array(self._range)
        walk[: self._forces] = self.process.still_N
        transition, noise = self._changed(dt_s, _period(evidence), evidence.acting, np.sqrt(dt_s) * walk)
        size = np.abs(evidence.compliance @ _free(evidence)) / self._unit
        noise[self._missed, self._missed] = np.diag(size**2) * self.process.wander**2 * dt_s
        noise[self._places, self._places] = (
            np.eye(2 * self.contacts) * (self.process.still_m / _UNIT_M) ** 2 * dt_s
        )
        return Change(transition, noise)

    def _moved(self, dt_s: float, evidence: Evidence, since: Evidence) -> Change:
        """Of forces and places that may be anything now; errors of the model and of seen places are the more
        in a new way the more has moved since.
        """
        transition, noise = self._changed(dt_s, _period(evidence), evidence.acting, self._any)
        transition[: self._drives] = 0.0
        kept = self._kept(evidence, since)
        for own, roots in (
            (self._missed, [self._model_root(each) for each in (evidence, since)]),
            (self._off, [self._off_root(each) for each in (evidence, since)]),
        ):
            now, before = roots
            transition[own, own] = kept * now @ np.linalg.inv(before)
            noise[own, own] = (1 - kept**2) * now @ now.T
        change = Change(transition, noise)
        self._relocated(change)
        return change

    def _kept(self, evidence: Evidence, since: Evidence) -> float:
        """How much [-] the errors of model and places have to do with those since when forces moved last."""
        sizes = [np.linalg.norm(each.compliance @ _free(each)) for each in (evidence, since)]
        if min(sizes) <= 0:
            return 0.0
        gone = np.linalg.norm(np.nan_to_num(evidence.seen_m - since.seen_m))
        return float(min(sizes) / max(sizes) * np.exp(-gone / self.process.alike_m))

    def _model_root(self, evidence: Evidence) -> Float[np.ndarray, "k k"]:
        """L of the covariance L Lᵀ of the model's error, which is never nothing."""
        least = np.diag((_CERTAIN * self._white(evidence) / self._unit) ** 2)
        return np.linalg.cholesky(evidence.model / np.outer(self._unit, self._unit) + least)

    def _off_root(self, evidence: Evidence) -> Float[np.ndarray, "P P"]:
        """Standard deviations by which what sees contacts is off as long as they stay."""
        sigma = np.sqrt(1 - self.process.white) * np.nan_to_num(evidence.seen_sigma_m)
        return np.diag(np.maximum(sigma / _UNIT_M, _CERTAIN))

    def _relocated(self, change: Change) -> None:
        """Let contacts be anywhere."""
        change.transition[self._places] = 0.0
        change.noise[self._places, self._places] = np.eye(2 * self.contacts) * (_ANYWHERE_M / _UNIT_M) ** 2

    def _reading(self, evidence: Evidence, since: Evidence) -> Reading:
        """Readings (k,), then places as they are seen (P,), with the slopes of another frame."""
        by_drive, by_place = since.compliance, since.by_place
        k, places = self.readings, 2 * self.contacts
        rows = np.zeros((k + places, self._size))
        rows[:k, : self._drives] = by_drive * self._drive_unit
        rows[:k, self._missed] = np.diag(self._unit)
        rows[:k, self._places] = by_place * _UNIT_M
        rows[np.arange(k), self._integral] = self._effect
        rows[k:, self._places] = rows[k:, self._off] = np.eye(places)
        size = by_drive @ _free(evidence)
        value = np.append(evidence.misfit + size + by_place @ evidence.place_m, evidence.seen_m / _UNIT_M)
        white = np.hypot(self._white(evidence), self.process.least * size)
        seen = np.sqrt(self.process.white) * evidence.seen_sigma_m / _UNIT_M
        return Reading(value, rows, np.append(white, seen))

    def _white(self, evidence: Evidence) -> Float[np.ndarray, " k"]:
        """Standard deviations (k,) of what is only in this frame's readings."""
        white = self._drift.white(_period(evidence))
        return np.where(self.drifting, white, _positive(evidence.sigma))

    def _outlier(
        self,
        known: Normal,
        change: Change,
        reading: Reading,
        acting: Bool[np.ndarray, " D"],
    ) -> Bool[np.ndarray, " k"]:
        """The reading (k,) without which the others do not contradict a change, though there are more of them
        than drives that act; none where there is no such.
        """
        found = np.zeros(self.readings, bool)
        heard = np.isfinite(reading.value)
        numbers, later = np.arange(len(heard)), known.gone_on(change)
        told = np.flatnonzero(heard[: self.readings])
        if len(told) <= acting.sum() + 1:
            return found
        left = [later.surprise(reading.only(heard & (numbers != each))) for each in told]
        best = int(np.argmin(left))
        if not self.process.surprising(left[best], heard.sum() - 1):
            found[told[best]] = True
        return found

    def _jumped(
        self,
        outlier: Bool[np.ndarray, " k"],
        known: Normal,
        change: Change,
        reading: Reading,
    ) -> Change:
        """A change in which an outlier's integral has jumped, by what the others do not explain of it."""
        others = ~np.append(outlier, np.zeros(len(reading.value) - self.readings, bool))
        told = known.gone_on(change).updated(_known(reading.only(others)))
        off = (reading.value - reading.rows @ told.mean)[: self.readings][outlier]
        noise, at = change.noise.copy(), self._integral[outlier]
        noise[at, at] += (off / self._effect[outlier]) ** 2
        return Change(change.transition, noise)


def _period(evidence: Evidence) -> float:
    """Between readings of the sensors [s]."""
    return max(float(evidence.drift.period_s), _SHORTEST_S)


def _free(evidence: Evidence) -> Float[np.ndarray, " D"]:
    """The drives (D,) without those that are known."""
    return np.where(evidence.acting, evidence.drive, 0.0)


def _positive(sigma: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Standard deviations (k,), where one is unknown as of a reading of unit size."""
    return np.where(np.isfinite(sigma) & (sigma > 0), sigma, 1.0)


def _known(reading: Reading) -> Reading:
    """Those numbers that are known."""
    return reading.only(np.isfinite(reading.value) & np.isfinite(reading.sigma))
