"""Where a press may be that no sensor sees: what readings say is compared with presses all over a surface."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from softfuse.estimation.estimator import Estimator
from softfuse.estimation.push_response import push_response
from softfuse.estimation.reading_pattern import PatternFit, pattern_fit
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.robot.robot import Robot

_SIDE = 13
"""Places along each side of a workspace that are compared with readings."""
_POSTURE_CHANGED = 0.05
"""Part of an actuator's range by which it may move before patterns are computed anew."""


class _Pattern(NamedTuple):
    """Where presses of the contact `slot` are looked for: places (s, 3, 3), `pitch_m` (2,) apart, and
    readings per newton there (s, k) of the robot at rest.
    """

    places: Float[np.ndarray, "s 3 3"]
    pitch_m: Float[np.ndarray, "2"]
    slot: int
    slopes: Float[np.ndarray, "s k"]


class PatternSearch:
    """Readings of presses all over the surface that the first contact may be on which no sensor sees, or the
    first with a workspace; slopes are those of the estimator's body as it stands, kept while it does.
    """

    def __init__(self, robot: Robot, estimator: Estimator | ReducedEstimator):
        """Nothing is computed before `prepare`."""
        self._robot, self._estimator = robot, estimator
        self._pattern: Future[_Pattern] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the slopes."""
        self._slopes: Float[np.ndarray, "s k"] | None = None
        self._posture = np.zeros(0)

    def prepare(self) -> Future[_Pattern]:
        """Find the places and what presses there do at rest; begun on a thread of its own, as it takes some
        seconds.
        """
        if self._pattern is None:
            thread = ThreadPoolExecutor(1)
            self._pattern = thread.submit(self._patterned)
            thread.shutdown(wait=False)
        return self._pattern

    def fit(
        self,
        posture: Float[np.ndarray, " a"],
        reading: Float[np.ndarray, " k"],
        covariance: Float[np.ndarray, "k k"],
        *,
        fresh: bool,
    ) -> PatternFit:
        """How well presses all over explain readings (k,), NaN where unknown, of errors (k, k).

        `posture` (a,): of actuators, as parts of their ranges; where it has changed, slopes are computed anew
        while the body is `fresh`: not pressed.
        """
        pattern = self.prepare().result()
        if self._slopes is None:
            self._slopes, self._posture = pattern.slopes, np.zeros_like(posture)
        if fresh and np.any(np.abs(posture - self._posture) > _POSTURE_CHANGED):
            places, of = jnp.asarray(pattern.places), self._estimator
            self._slopes = np.asarray(push_response(of.device, places, of.state, pattern.slot))
            self._posture = posture
        valid, kinds = np.isfinite(reading), self._robot.reading_kinds
        return pattern_fit(pattern.places, pattern.pitch_m, self._slopes, reading, covariance, valid, kinds)

    def _patterned(self) -> _Pattern:
        robot, model = self._robot, self._estimator.device
        flags = robot.unseen if robot.unseen.any() else [each is not None for each in robot.workspaces]
        slot = int(np.argmax(flags))
        workspace = robot.workspaces[slot]
        assert workspace is not None  # the tracker has told
        places, pitch = workspace.grid(_SIDE)
        slopes = np.asarray(push_response(model, jnp.asarray(places), model.rest_state(()), slot))
        return _Pattern(places, pitch, slot, slopes)
