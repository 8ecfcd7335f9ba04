"""A contact that no sensor sees, followed by what readings say that nothing else explains.

Unexplained is what is read minus what the model would read if nothing pressed: in frames in which nothing
does that is its reading, later the same and what actuators have added since.
"""

import numpy as np
from jaxtyping import Bool, Float

from softfuse.estimation.estimator import Estimate, Estimator
from softfuse.estimation.pattern_search import PatternSearch
from softfuse.estimation.reading_pattern import PatternFit
from softfuse.estimation.reduced_estimator import ReducedEstimator
from softfuse.estimation.touch_by_readings import TouchByReadings
from softfuse.robot.robot import Robot


class UnseenTouch:
    """Follows what readings alone tell of the contacts on a robot."""

    def __init__(
        self, robot: Robot, estimator: Estimator | ReducedEstimator, attached_range: Float[np.ndarray, " a"]
    ):
        """`attached_range` (a,): how far what is attached, such as actuators, may be driven, in its units."""
        self._patterns, self._touch = PatternSearch(robot, estimator), TouchByReadings()
        self._readings, self._range = estimator.device.n_readings, attached_range
        self.alone = bool(robot.unseen.any())
        """Whether there is a contact that no sensor ever sees."""
        self.slot = int(np.argmax(robot.unseen))
        """The number of that contact."""
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing has been read, nothing touches."""
        self._patterns.reset()
        self._unpressed, self._attached = np.zeros(self._readings), np.zeros(len(self._range))
        self.lose()

    def lose(self) -> None:
        """What is read is not explained, as the estimate was lost."""
        self._touch.reset()
        self._unexplained = np.full(self._readings, np.nan)
        self._uncertain = np.zeros((self._readings, self._readings))

    def prepare(self) -> None:
        """Begin to compute what finds such contacts, which takes some seconds."""
        self._patterns.prepare()

    @property
    def touching(self) -> bool:
        """Whether it touches."""
        return self._touch.touching

    def read(
        self,
        reading: Float[np.ndarray, " k"],
        valid: Bool[np.ndarray, " k"],
        uncertain: Float[np.ndarray, "k k"],
    ) -> None:
        """What a frame reads (k,), and the covariance (k, k) of its and the model's errors."""
        self._unexplained = np.where(valid, reading - self._unpressed, np.nan)
        self._uncertain = uncertain

    def model(self, modelled: Float[np.ndarray, " k"], found: Estimate, contact_drives: int) -> None:
        """What the model reads (k,) of an estimate whose first `contact_drives` drives are those of
        contacts.
        """
        force, attached = np.split(np.asarray(found.drive), [contact_drives])
        by_drive = np.asarray(found.report.compliance)[:, contact_drives:]
        added = self._unpressed + by_drive @ (attached - self._attached)
        before, self._unpressed = self._unpressed, added if force.any() else modelled
        self._attached = attached
        self._unexplained = self._unexplained + before - self._unpressed

    def fit(self, *, fresh: bool) -> PatternFit:
        """How well presses all over explain what nothing else did in the last frame; `fresh`: in which
        nothing pressed.
        """
        free = self._range > 0
        return self._patterns.fit(
            self._attached[free] / self._range[free], self._unexplained, self._uncertain, fresh=fresh
        )

    def follow(self, force_N: float, sigma_N: float, *, seen: bool, pressed: bool) -> None:
        """Whether it has begun or gone after a frame in which it pressed so hard, so surely known; `seen`:
        something that does see it says so, `pressed`: anything did press.
        """
        if self._touch.touching:
            self._touch.ends(force_N, sigma_N)
        elif not seen and np.isfinite(self._unexplained).any():
            self._touch.begins(self.fit(fresh=not pressed))
