"""Fitting a robot's parameters to presses of known place and force.

Rounds of Gauss-Newton: the robot answers with readings and slopes (`Adjustable`); on these, the discrepancy
δ is the one that makes the readings most likely (`Discrepancy`), and the parameters those that explain them
best (`robust`); then the robot is asked again. A step that gains less than half of what its slopes promise
is tried again where a parabola is least, one to a robot that cannot carry its loads half as far. Rounds end
when no step promises more than a fiftieth in the logarithm of the posterior: parameters are then within a
fifth of their standard deviations.
"""

from abc import ABC
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from softfuse.calibration.adjustment import Measure
from softfuse.calibration.presses import Adjustable, Answer, Applied, Presses
from softfuse.calibration.robust import Discrepancy, Explained, Linear, Whitening, cost, explained
from softfuse.errors import SoftfuseError, SolveError
from softfuse.estimation.model_error import FLOOR, ReadingSpread
from softfuse.mechanics.solution import State

_SETTLED = 0.02
"""What a step must promise."""

_SHORTENED = 4
"""How often a step is tried."""

_PARTS, _FLOORS, _FIRST_PART = (1e-4, 0.3), (3e-3, 1.0), 0.02
"""Discrepancies between which the likeliest is searched, and from which on."""

_FLOOR_SIGMA = 1.5
"""By how much the logarithm of a floor differs from robot to robot."""


class AbstractPosterior(ABC):
    """p parameters with `names` and `measures`: `value` (p,), `covariance` (p, p) and `prior_sigma` (p,) in
    the units of their measures.
    """

    names: tuple[str, ...]
    measures: tuple[Measure, ...]
    value: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    prior_sigma: Float[np.ndarray, " p"]

    @property
    def sigma(self) -> Float[np.ndarray, " p"]:
        """Standard deviations (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> Float[np.ndarray, " p"]:
        """How much of each parameter the presses tell (p,): 0 nothing beyond the prior, 1 all of it."""
        return 1 - (self.sigma / self.prior_sigma) ** 2

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Of the parameters (p, p)."""
        return self.covariance / np.outer(self.sigma, self.sigma)


@dataclass(frozen=True, eq=False)
class Fit(AbstractPosterior):
    """What presses say of p parameters with `names` and `measures`.

    `value` (p,), `covariance` (p, p) and `prior_sigma` (p,) in SI; `discrepancy`: what the model misses at
    best; `before`, `after` (s, k): measured minus modelled readings with all parameters 0 and as fitted;
    `weight` (s, k) [-]: how much the readings of a press count, far below 1 where nothing explains them, 0
    where they say nothing; `states` (s,): equilibria with parameters next to the fitted ones.
    """

    names: tuple[str, ...]
    measures: tuple[Measure, ...]
    value: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    prior_sigma: Float[np.ndarray, " p"]
    discrepancy: Discrepancy
    before: Float[np.ndarray, "s k"]
    after: Float[np.ndarray, "s k"]
    weight: Float[np.ndarray, "s k"]
    states: tuple[State, ...]


def fit(
    adjustable: Adjustable, presses: Presses, *, rounds: int = 10, seen: Callable[[], None] = lambda: None
) -> Fit:
    """The parameters that explain presses best; `seen` is called after each sample that was answered.

    Raises SoftfuseError when no sample says anything, or parameters still move after so many rounds; and
    SolveError as `Adjustable.answer` does.
    """
    if not presses.told.any():
        raise SoftfuseError(
            "no sample of the presses has a reading to fit: zeros are taken before the first press, while "
            "for some seconds nothing touches the robot and no actuator drives it, cables within their slack"
        )
    prior = np.asarray(adjustable.adjustments.sigma)
    group = _groups(presses)

    def ask(z: Float[np.ndarray, " p"], before: Answer | None = None) -> Answer:
        near = None if before is None else before.states
        return adjustable.answer(z * prior, presses.applied, near=near, seen=seen)

    z, answer = np.zeros(len(prior)), ask(np.zeros(len(prior)))
    before = presses.reading - answer.reading
    for _ in range(rounds):
        at = _Round(presses, answer, z, prior, group)
        discrepancy = _likeliest(at)
        whitening, aim = discrepancy.whitening(presses), at.explained(discrepancy)
        here = at.cost(whitening, answer, z)
        if here - aim.cost < _SETTLED:
            step = (aim.z - z) * prior
            after = presses.reading - answer.reading - np.einsum("skp,p->sk", answer.slope, step)
            return Fit(
                adjustable.adjustments.names,
                adjustable.adjustments.measures,
                aim.z * prior,
                np.linalg.inv(aim.information) * np.outer(prior, prior),
                prior,
                discrepancy,
                before,
                after,
                np.where(presses.told, aim.weight[group], 0.0),
                answer.states,
            )
        z, answer = at.stepped(ask, whitening, here, aim)
    raise SoftfuseError(
        f"the parameters still move after {rounds} rounds: narrow what may differ in [calibration]"
    )


@dataclass(frozen=True, eq=False)
class _Round:
    """Presses, and what the robot with parameters z (p,), in prior standard deviations, answered."""

    presses: Presses
    answer: Answer
    z: Float[np.ndarray, " p"]
    prior: Float[np.ndarray, " p"]
    group: Int[np.ndarray, "s k"]

    @property
    def groups(self) -> int:
        """How many groups."""
        return int(self.group.max()) + 1

    def explained(self, discrepancy: Discrepancy) -> Explained:
        """The parameters that explain the presses best with a discrepancy."""
        return explained(self._linear(discrepancy.whitening(self.presses)), self.groups)

    def ln_evidence(self, discrepancy: Discrepancy) -> float:
        """How likely the presses are with a discrepancy."""
        whitening = discrepancy.whitening(self.presses)
        found = explained(self._linear(whitening), self.groups)
        return found.ln_evidence - 0.5 * whitening.ln_det

    def cost(self, whitening: Whitening, answer: Answer, z: Float[np.ndarray, " p"]) -> float:
        """What the parameters z, whose answer is given, cost."""
        left = whitening.of(self.presses.reading - answer.reading).ravel()
        return float(cost(left, self._linear(whitening), z, self.groups))

    def stepped(
        self, ask: Callable[..., Answer], whitening: Whitening, here: float, aim: Explained
    ) -> tuple[Float[np.ndarray, " p"], Answer]:
        """Parameters that cost less than z, which costs `here`, on the way to those that explain the presses
        by their slopes, and their answer.

        Raises SoftfuseError where none of those tried is better, SolveError where the last had no answer.
        """
        step = aim.z - self.z
        promised, length, found, failed = here - aim.cost, 1.0, (here, self.z, self.answer), None
        for _ in range(_SHORTENED):
            tried = self.z + length * step
            try:
                read = ask(tried, self.answer)
            except SolveError as error:
                length, failed = length / 2, error
                continue
            there, failed = self.cost(whitening, read, tried), None
            found = min(found, (there, tried, read), key=lambda each: each[0])
            if here - there > 0.5 * promised * length * (2 - length):
                break
            # Where the parabola through both ends is least, of slope −2 promised at z.
            length = promised * length**2 / (there - here + 2 * promised * length)
        if not found[0] < here:
            raise failed or SoftfuseError(
                "the fit finds no better parameters although its slopes promise some: leave out the presses "
                "that are furthest off"
            )
        return found[1:]

    def _linear(self, whitening: Whitening) -> Linear:
        slope = self.answer.slope * self.prior
        left = self.presses.reading - self.answer.reading + np.einsum("skp,p->sk", slope, self.z)
        flat = whitening.of(slope).reshape(-1, len(self.z))
        return Linear(
            whitening.of(left).ravel(), flat, self.group.ravel(), np.asarray(self.presses.told).ravel()
        )


def _groups(presses: Presses) -> Int[np.ndarray, "s k"]:
    """The number (s, k) of each reading's group: one cavity in one press."""
    _, press = np.unique(presses.applied.press, return_inverse=True)
    count = presses.reading.shape[1]
    return press[:, None] * count + np.arange(count)


def _likeliest(at: _Round) -> Discrepancy:
    """The discrepancy that makes presses likeliest, another for each kind of readings: what the model misses
    of a pressure says nothing of curvatures. Floors far from the usual one are unlikely: one reading of a
    kind tells nothing of it.
    """
    kinds, own = np.unique(at.presses.kind, return_inverse=True)

    def discrepancy(ln: Float[np.ndarray, " two_n"]) -> Discrepancy:
        part, floor = np.exp(ln).reshape(2, -1)
        return Discrepancy(part[own], floor[own])

    def unlikely(ln: Float[np.ndarray, " two_n"]) -> float:
        beyond = (ln[len(kinds) :] - np.log(FLOOR)) / _FLOOR_SIGMA
        return 0.5 * float(beyond @ beyond) - at.ln_evidence(discrepancy(ln))

    start, bounds = (
        np.repeat(np.log(each), len(kinds), 0) for each in ([_FIRST_PART, FLOOR], [_PARTS, _FLOORS])
    )
    found = minimize(unlikely, start, method="Powell", bounds=bounds, options={"xtol": 0.02, "ftol": 1e-4})
    return discrepancy(found.x)


def gain(
    fit: Fit, answer: Answer, noise: Float[np.ndarray, " k"], kind: Int[np.ndarray, " k"]
) -> Float[np.ndarray, " s"]:
    """What each of s further presses would tell [nat], so that the best is the D-optimal one.

    A press that reads with slopes J (k, p) and covariance S (k, k) turns the parameters' covariance C into
    (C⁻¹ + Jᵀ S⁻¹ J)⁻¹ and gains ½ ln det(I + S⁻¹ J C Jᵀ). Source: Chaloner and Verdinelli, Stat. Sci. 10
    (1995) 273. Answers are those of the fitted parameters; `noise` (k,): standard deviations of the readings
    in SI; `kind` (k,): see `model_error.missed`.
    """
    sigma = np.hypot(noise, fit.discrepancy.missed(answer.reading, kind))
    whitened = answer.slope / sigma[..., None]
    seen = np.einsum("skp,pq,slq->skl", whitened, fit.covariance, whitened)
    return 0.5 * np.linalg.slogdet(np.eye(seen.shape[1]) + seen)[1]


def spread_over(applied: Applied, answer: Answer, covariance: Float[np.ndarray, "p p"]) -> ReadingSpread:
    """How uncertain readings are all over a surface, as a robot whose parameters are so uncertain answers
    presses (s,) of its first contact by itself, its actuators always the same.
    """
    by_parameters = answer.slope @ np.linalg.cholesky(covariance)
    return ReadingSpread(applied.place[:, 0, 0], by_parameters / applied.force_N[:, 0, None, None])
