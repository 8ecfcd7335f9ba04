"""A contact that no sensor sees: whether and where readings say that something presses.

A press with a small force F at a place p changes the readings by F w(p), w = ∂s/∂F of the robot as it is
(`push_response`). Of readings y that nothing else explains, with errors of covariance L Lᵀ, the place where

    χ²(p) = min over F ≥ 0 of |L⁻¹ (y − F w(p))|²

is least explains them best. That is rough, as under larger forces patterns change, but it finds the region
from which the estimate's own steps go on to the place itself, and tells of others that the readings do not
rule out: presses there have a share of exp(−χ²/2) over that of all.

Unexplained is what is read minus what the model would read if nothing pressed: in frames in which nothing
does that is its reading, later the same and what actuators have added since.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.estimation.estimator import Estimate, Estimator
from softfuse.estimation.model_error import ModelError, missed, whitening
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.estimation.rest_response import push_response
from softfuse.robot.robot import Robot

_CHANGED = 0.05
"""Part of a reading by which the pattern of a small force may be off that of a large one."""
_CLEARLY = 9.0
"""By how much χ² has to be less elsewhere for the search to begin anew there."""

_SIDE = 13
"""Places along each side of a workspace that are compared with readings."""

_POSTURE_CHANGED = 0.05
"""Part of an actuator's range by which it may move before patterns are computed anew."""


def offsets(place: Float[np.ndarray, "3 3"], others: Float[np.ndarray, "s 3 3"]) -> Float[np.ndarray, "s 2"]:
    """How far others (s, 3, 3) are from a place (3, 3), along its tangents (s, 2) [m]."""
    return (others[:, 0] - place[0]) @ place[1:].T


def pattern_fit(
    places: Float[np.ndarray, "s 3 3"],
    pitch_m: Float[np.ndarray, "2"],
    slope: Float[np.ndarray, "s k"],
    reading: Float[np.ndarray, " k"],
    covariance: Float[np.ndarray, "k k"],
    valid: Bool[np.ndarray, " k"],
    kind: Int[np.ndarray, " k"] | None = None,
    misfit: Float[np.ndarray, " k"] | None = None,
) -> "PatternFit":
    """How well a press at each place (s, 3, 3), `pitch_m` (2,) apart, with readings per newton (s, k) [SI/N]
    explains valid readings (k,) of a covariance (k, k) and of so many kinds (k,), see `model_error.missed`;
    and how well the estimate before does, which left a `misfit` (k,), None where there was none.
    """
    reading = np.where(valid, reading, 0.0)
    white = whitening(covariance + np.diag(missed(reading, _CHANGED, kind) ** 2), valid)
    seen, slope = white @ reading, slope @ white.T
    size = np.maximum(np.sum(slope**2, axis=1), np.finfo(float).tiny)
    force = np.maximum(slope @ seen, 0.0) / size
    left = np.inf if misfit is None else float(np.sum((white @ np.where(valid, misfit, 0.0)) ** 2))
    return PatternFit(places, pitch_m, force, seen @ seen - force**2 * size, float(seen @ seen), left)


class Elsewhere(NamedTuple):
    """What share [-] presses elsewhere have, and the mean squares of how far places, along the estimate's
    tangents (2,) [m²], and the force [N²] of these are from the estimate.
    """

    share: float
    place_m2: Float[np.ndarray, "2"]
    force_N2: float


@dataclass(frozen=True, eq=False)
class PatternFit:
    """The force (s,) [N] that explains readings best at each place (s, 3, 3), `pitch_m` (2,) apart, and its
    χ² (s,); χ² without any, and of what the estimate before `left`, infinite where there was none.
    """

    place: Float[np.ndarray, "s 3 3"]
    pitch_m: Float[np.ndarray, "2"]
    force_N: Float[np.ndarray, " s"]
    missing: Float[np.ndarray, " s"]
    unexplained: float
    left: float = np.inf

    @property
    def best(self) -> int:
        """The number of the place that explains them best."""
        return int(np.argmin(self.missing))

    def better(self, place: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"] | None:
        """The best place (3, 3), None where it is not clearly better than the estimate's (3, 3): than a small
        force there and than the estimate itself, which knows how patterns change under larger ones.
        """
        here = np.argmin(np.sum((self.place[:, 0] - place[0]) ** 2, axis=1))
        missing = min(self.missing[here], self.left)
        return self.place[self.best] if missing - self.missing[self.best] > _CLEARLY else None

    def elsewhere(self, place: Float[np.ndarray, "3 3"], force_N: float) -> Elsewhere:
        """Presses that explain readings too, beyond a pitch from one at a place (3, 3) with a force [N]."""
        off = offsets(place, self.place)
        away = np.linalg.norm(self.place[:, 0] - place[0], axis=1) > np.linalg.norm(self.pitch_m)
        away |= np.any(np.abs(off) > self.pitch_m, axis=1)
        part = np.exp(-0.5 * (self.missing - self.missing.min()))
        part = np.where(away, part / part.sum(), 0.0)
        share = part.sum()
        part = part / max(share, np.finfo(float).tiny)
        return Elsewhere(float(share), part @ off**2, float(part @ (self.force_N - force_N) ** 2))


@dataclass(frozen=True)
class TouchSettings:
    """When a touch begins and ends.

    It begins when a press somewhere on the surface explains the readings better than none by more than
    `on_chi2`, in `on_frames` frames in a row, and leaves less than `left` of what nothing had explained: what
    no press explains is the model's error, not a touch. However large the readings are, if nothing presses
    the model can only be wrong about what actuators do. It ends when for `off_frames` frames its force has
    been within `off_sigma` standard deviations of 0, and none would have begun: where it presses may be so
    uncertain that its force is, too, while nothing but a press explains the readings.
    """

    on_chi2: float = 36.0
    on_frames: int = 3
    left: float = 0.5
    off_sigma: float = 2.0
    off_frames: int = 5


class TouchByReadings:
    """Follows one contact that readings alone tell of."""

    def __init__(self, settings: TouchSettings = TouchSettings()):
        """Nothing touches."""
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.touching, self._frames = False, 0

    def begins(self, fit: Callable[[], PatternFit], untouched: float) -> bool:
        """Whether it touches after a frame in which nothing did, with the χ² of an `untouched` robot and what
        presses all over would explain: that is only asked for where it matters.
        """
        return self._counted(self._noticed(fit, untouched), self._settings.on_frames)

    def ends(self, force_N: float, sigma_N: float, fit: Callable[[], PatternFit], untouched: float) -> bool:
        """Whether it has gone after a frame in which it pressed with such a force, so surely known, and with
        the same as where one `begins`.
        """
        gone = not force_N > self._settings.off_sigma * sigma_N and not self._noticed(fit, untouched)
        return not self._counted(gone, self._settings.off_frames)

    def _noticed(self, fit: Callable[[], PatternFit], untouched: float) -> bool:
        """Whether readings tell that something presses."""
        if not untouched > self._settings.on_chi2:
            return False
        found = fit()
        left = found.missing[found.best]
        return untouched - left > self._settings.on_chi2 and left < self._settings.left * found.unexplained

    def _counted(self, changes: bool, frames: int) -> bool:
        self._frames = self._frames + 1 if changes else 0
        if self._frames >= frames:
            self.touching, self._frames = not self.touching, 0
        return self.touching


class _Pattern(NamedTuple):
    """Where presses of the contact `slot` are looked for: places (s, 3, 3), `pitch_m` (2,) apart, and
    readings per newton there (s, k) of the robot at rest.
    """

    places: Float[np.ndarray, "s 3 3"]
    pitch_m: Float[np.ndarray, "2"]
    slot: int
    slopes: Float[np.ndarray, "s k"]


class UnseenTouch:
    """Follows what readings alone tell of the contacts on a robot.

    Readings are compared with presses all over the surface that the first contact may be on which no sensor
    sees, or the first with a workspace; slopes are those of the body as it stands, kept while it does.
    """

    def __init__(
        self, robot: Robot, estimator: Estimator | ReducedEstimator, attached_range: Float[np.ndarray, " a"]
    ):
        """`attached_range` (a,): how far what is attached, such as actuators, may be driven, in its units."""
        self._robot, self._estimator, self._range = robot, estimator, attached_range
        self._touch, self._pattern = TouchByReadings(), None
        self._readings = estimator.model.n_readings
        self.alone = bool(robot.unseen.any())
        """Whether there is a contact that no sensor ever sees."""
        self.slot = int(np.argmax(robot.unseen))
        """The number of that contact."""
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._slopes: Float[np.ndarray, "s k"] | None = None
        self._posture = np.zeros(0)
        self._unpressed, self._attached = np.zeros(self._readings), np.zeros(len(self._range))
        self.lose()

    def lose(self) -> None:
        """What is read is not explained, as the estimate was lost."""
        self._touch.reset()
        self._unexplained = np.full(self._readings, np.nan)
        self._misfit: Float[np.ndarray, " k"] | None = None
        self._uncertain = np.zeros((self._readings, self._readings))
        self._error, self._sigma = ModelError(), np.zeros(self._readings)

    def prepare(self) -> Future[_Pattern]:
        """Find places and what presses there do at rest; begun on a thread of its own: it takes seconds."""
        if self._pattern is None:
            thread = ThreadPoolExecutor(1)
            self._pattern = thread.submit(self._patterned)
            thread.shutdown(wait=False)
        return self._pattern

    def _patterned(self) -> _Pattern:
        robot, model = self._robot, self._estimator.model
        flags = robot.unseen if robot.unseen.any() else [each is not None for each in robot.workspaces]
        slot = int(np.argmax(flags))
        workspace = robot.workspaces[slot]
        assert workspace is not None  # the tracker has told
        places, pitch = workspace.grid(_SIDE)
        slopes = np.asarray(push_response(model, jnp.asarray(places), model.rest_state(()), slot))
        return _Pattern(places, pitch, slot, slopes)

    @property
    def touching(self) -> bool:
        """Whether it touches."""
        return self._touch.touching

    def read(
        self,
        reading: Float[np.ndarray, " k"],
        valid: Bool[np.ndarray, " k"],
        sigma: Float[np.ndarray, " k"],
        error: ModelError,
        uncertain: Float[np.ndarray, "k k"],
    ) -> None:
        """What a frame reads (k,) with sensors' noise (k,), the model's error, and the covariance (k, k) of
        both under what presses.
        """
        self._unexplained = np.where(valid, reading - self._unpressed, np.nan)
        self._sigma, self._error, self._uncertain = sigma, error, uncertain

    def model(self, modelled: Float[np.ndarray, " k"], found: Estimate, contact_drives: int) -> None:
        """What the model reads (k,) of an estimate whose first `contact_drives` drives are contacts'."""
        force, attached = np.split(np.asarray(found.drive), [contact_drives])
        self._misfit = np.asarray(found.misfit)
        by_drive = np.asarray(found.report.compliance)[:, contact_drives:]
        added = self._unpressed + by_drive @ (attached - self._attached)
        before, self._unpressed = self._unpressed, added if force.any() else modelled
        self._attached = attached
        self._unexplained = self._unexplained + before - self._unpressed

    def fit(self, *, fresh: bool) -> PatternFit:
        """How well presses all over explain what nothing else did in the last frame; where actuators have
        moved, slopes are computed anew while the body is `fresh`: nothing pressed in it.
        """
        pattern, free = self.prepare().result(), self._range > 0
        posture = self._attached[free] / self._range[free]
        if self._slopes is None:
            self._slopes, self._posture = pattern.slopes, np.zeros_like(posture)
        if fresh and np.any(np.abs(posture - self._posture) > _POSTURE_CHANGED):
            places, of = jnp.asarray(pattern.places), self._estimator
            self._slopes = np.asarray(push_response(of.model, places, of.state, pattern.slot))
            self._posture = posture
        reading, kinds = self._unexplained, self._robot.reading_kinds
        return pattern_fit(
            pattern.places,
            pattern.pitch_m,
            self._slopes,
            reading,
            self._uncertain,
            np.isfinite(reading),
            kinds,
            self._misfit,
        )

    def follow(self, force_N: float, sigma_N: float, *, seen: bool, pressed: bool) -> None:
        """Whether it has begun or gone after a frame in which it pressed so hard, so surely known; `seen`:
        something that does see it says so, `pressed`: anything did press.
        """
        touching = self._touch.touching
        if not touching and (seen or not np.isfinite(self._unexplained).any()):
            return
        given = lambda: self.fit(fresh=not pressed), self._untouched()
        if touching:
            self._touch.ends(force_N, sigma_N, *given)
        else:
            self._touch.begins(*given)

    def _untouched(self) -> float:
        """χ² of what was read if nothing presses: the model is wrong about what actuators do only."""
        valid = np.isfinite(self._unexplained)
        white = whitening(self._error.without_contacts(self._unpressed, self._sigma), valid)
        left = white @ np.where(valid, self._unexplained, 0.0)
        return float(left @ left)
