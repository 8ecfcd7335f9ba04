"""Forces and sensors' drift from one frame to the next.

State x = (u, m, δ): drives u (D,), what the model misses of each of k readings m (k,), and what each sensor
drifts by, δ (3,), see `sensing.reading_drift`. A frame says

    y − s(u₀) + W u₀ = W u + m + diag(ρ) δ₃ + v.

δ goes on as the zero of a sensor does. While forces are still, u walks slowly at random and m stays, so that
what readings show besides is drift. Where a frame contradicts that, forces have moved: u may be anything and
m is new, of the covariance of the model's error. Drift is not learnt from such frames, as the errors of the
model in one after the other are not independent; that also is why m is not averaged away. Where a frame
contradicts that as well, but only in one reading, this is an outlier: what was integrated is off by as much
from there on. W changes only as forces move, lest its jitter tell u from m.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from softfuse.estimation.tracked import Evidence
from softfuse.fusion.normal import Change, Normal, Reading, Step
from softfuse.fusion.process import Process
from softfuse.sensing.reading_drift import DriftModel, ReadingDrift

_UNIT_V = 1e-3
"""Of δ in the state: drifts are some millivolts."""

_SHORTEST_S = 1e-3
"""Between readings: no reading is without noise."""

_ANY = 100.0
"""Of a range: standard deviation of drives that may be anything, as good as infinite."""


class ForceStep(NamedTuple):
    """A frame's step, which readings (k,) were outliers, W (k, D) when forces moved last, which drives (D,)
    act, whether they moved, and whether forces are known.
    """

    step: Step
    outlier: Bool[np.ndarray, " k"]
    compliance: Float[np.ndarray, "k D"]
    acting: Bool[np.ndarray, " D"]
    moved: bool = False
    known: bool = True


class ForceFilter:
    """Joins the frames of a touch, of c contacts and k readings."""

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
        self._range, self.readings, self.contacts = range_, len(self._effect), len(adding)
        self._drives, self._forces = len(range_), adding.shape[1]
        self._size = self._drives + 4 * self.readings
        self._missed = slice(self._drives, self._drives + self.readings)
        self._drifts = slice(self._missed.stop, None)
        self._any = _ANY * range_
        self._unit = np.abs(self._effect)
        self._integral = self._missed.stop + 2 + 3 * np.arange(self.readings)
        drift.step(_SHORTEST_S, _SHORTEST_S)  # compiled here, not while the first contact waits for it

    def begun(self, drift: ReadingDrift, compliance: Float[np.ndarray, "k D"]) -> ForceStep:
        """Before the first frame: nothing presses."""
        covariance = np.zeros((self._size, self._size))
        for at, own in zip(self._integral, np.asarray(drift.covariance), strict=True):
            covariance[at - 2 : at + 1, at - 2 : at + 1] = own / _UNIT_V**2
        begun = Normal(np.zeros(self._size), covariance)
        none = Change(np.eye(self._size), np.zeros_like(covariance))
        calm, idle = np.zeros(self.readings, bool), np.zeros(self._drives, bool)
        return ForceStep(Step(none, begun, begun), calm, compliance, idle)

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
        heard, acting, compliance = np.isfinite(evidence.misfit), evidence.acting, before.compliance
        reading, change = self._reading(evidence, compliance).only(heard), self._still(dt_s, evidence)
        begins = bool(np.any(acting & ~before.acting))
        moved = (
            begins
            or self._surprising(known, change, reading)
            or any(self._contradicted(step, since_s, evidence) for since_s, step in anchors)
        )
        if moved:
            anew, free = self._reading(evidence, evidence.compliance).only(heard), self._moved(dt_s, evidence)
            if self._surprising(known, free, anew):
                if not begins:
                    outlier = self._outlier(known, change, reading, heard, acting)
                moved = not outlier.any()
                if moved:
                    outlier = self._outlier(known, free, anew, heard, acting)
            if moved:
                change, reading, compliance = free, anew, evidence.compliance
            if outlier.any():
                change = self._jumped(outlier, known, change, reading, heard)
        later = known.gone_on(change)
        told = later.updated(reading, considered=self._drifts if moved else slice(0))
        return ForceStep(Step(change, later, told), outlier, compliance, acting, moved)

    def unknown(self, before: ForceStep, dt_s: float) -> ForceStep:
        """The next frame, dt_s [s] later, in which nothing is known of forces."""
        none = np.zeros(self._drives, bool)
        change = self._changed(dt_s, max(dt_s, _SHORTEST_S), none, self._any)
        later = before.step.known.gone_on(change)
        no = np.zeros(self.readings, bool)
        return ForceStep(Step(change, later, later), no, before.compliance, none, moved=True, known=False)

    def rested(
        self, known: Normal, evidence: Evidence, calm: Bool[np.ndarray, " k"], largest: float
    ) -> Normal:
        """With what readings say that are calm (k,), as the body is at rest again after readings of up to
        `largest`.
        """
        reading = self._reading(evidence, evidence.compliance)
        rows = np.where(np.arange(self._size) < self._missed.stop, 0.0, reading.rows)
        sigma = np.hypot(reading.sigma, self.process.creep * largest)
        at_rest = Reading(reading.value, rows, sigma)
        # What is far from any drift is no rest: something still presses that is not seen.
        own = np.arange(self.readings)
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

    def drift(self, known: Normal) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """What readings (k,) are off by, in SI, and the standard deviations of that."""
        variance = np.maximum(np.diag(known.covariance)[self._integral], 0.0)
        return self._effect * known.mean[self._integral], self._unit * np.sqrt(variance)

    def _contradicted(self, anchor: ForceStep, since_s: float, evidence: Evidence) -> bool:
        """Whether forces cannot have been still for so long [s]."""
        reading = self._reading(evidence, anchor.compliance).only(np.isfinite(evidence.misfit))
        return self._surprising(anchor.step.known, self._still(since_s, evidence), reading)

    def _surprising(self, known: Normal, change: Change, reading: Reading) -> bool:
        """Whether readings contradict a change."""
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
        """Of drives that act or not and walk by (D,), and of drifts; what the model misses stays as long as
        something acts.
        """
        transition, noise = np.eye(self._size), np.zeros((self._size, self._size))
        drives = np.arange(self._drives)
        transition[drives, drives] = acting
        noise[drives, drives] = np.where(acting, walk**2, 0.0)
        transition[self._missed] *= acting.any()
        own, chance = self._drift.step(dt_s, period_s)
        transition[self._drifts, self._drifts] = np.kron(np.eye(self.readings), own)
        noise[self._drifts, self._drifts] = np.kron(np.eye(self.readings), chance / _UNIT_V**2)
        return Change(transition, noise)

    def _still(self, dt_s: float, evidence: Evidence) -> Change:
        """Of forces that hardly move."""
        walk = np.array(self._range)
        walk[: self._forces] = self.process.still_N
        transition, noise = self._changed(dt_s, _period(evidence), evidence.acting, np.sqrt(dt_s) * walk)
        size = np.abs(evidence.compliance @ evidence.drive) / self._unit
        noise[self._missed, self._missed] = np.diag(size**2) * self.process.wander**2 * dt_s
        return Change(transition, noise)

    def _moved(self, dt_s: float, evidence: Evidence) -> Change:
        """Of forces that may be anything now, while the model is wrong in a new way."""
        transition, noise = self._changed(dt_s, _period(evidence), evidence.acting, self._any)
        transition[: self._drives] = 0.0
        transition[self._missed] = 0.0
        noise[self._missed, self._missed] = evidence.model / np.outer(self._unit, self._unit)
        return Change(transition, noise)

    def _reading(self, evidence: Evidence, compliance: Float[np.ndarray, "k D"]) -> Reading:
        rows = np.zeros((self.readings, self._size))
        rows[:, : self._drives] = compliance
        rows[:, self._missed] = np.diag(self._unit)
        rows[np.arange(self.readings), self._integral] = self._effect
        size = compliance @ evidence.drive
        white = self._drift.white(_period(evidence))
        return Reading(evidence.misfit + size, rows, np.hypot(white, self.process.least * size))

    def _outlier(
        self,
        known: Normal,
        change: Change,
        reading: Reading,
        heard: Bool[np.ndarray, " k"],
        acting: Bool[np.ndarray, " D"],
    ) -> Bool[np.ndarray, " k"]:
        """The reading (k,) without which the others do not contradict a change, though there are more of them
        than drives that act; none where there is no such.
        """
        found = np.zeros(self.readings, bool)
        numbers, later = np.arange(len(reading.value)), known.gone_on(change)
        if len(numbers) <= acting.sum() + 1:
            return found
        left = [later.surprise(reading.only(numbers != each)) for each in numbers]
        best = int(np.argmin(left))
        if not self.process.surprising(left[best], len(numbers) - 1):
            found[np.flatnonzero(heard)[best]] = True
        return found

    def _jumped(
        self,
        outlier: Bool[np.ndarray, " k"],
        known: Normal,
        change: Change,
        reading: Reading,
        heard: Bool[np.ndarray, " k"],
    ) -> Change:
        """A change in which an outlier's integral has jumped."""
        off = (reading.value - reading.rows @ known.gone_on(change).mean)[outlier[heard]]
        noise, at = change.noise.copy(), self._integral[outlier]
        noise[at, at] += (off / self._effect[outlier]) ** 2
        return Change(change.transition, noise)


def _period(evidence: Evidence) -> float:
    """Between readings of the sensors [s]."""
    return max(float(evidence.drift.period_s), _SHORTEST_S)
