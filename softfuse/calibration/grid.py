"""Presses all over a workspace, of which none was made: where they would tell most, and how uncertain
readings are under each.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.calibration.presses import Answer
from softfuse.estimation.model_error import ReadingSpread

_SIDE = 11
"""Places in each direction."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Places of x (a,) and y (b,) [m], all pressed with one force [N]."""

    x_m: Float[np.ndarray, " a"]
    y_m: Float[np.ndarray, " b"]
    each_N: float

    @classmethod
    def over(cls, x: tuple[float, float], y: tuple[float, float], force: float, side: int = _SIDE) -> "Grid":
        """The grid over ranges of x and y [m], of `side` places in each direction."""
        return cls(np.linspace(*x, side), np.linspace(*y, side), force)

    @property
    def point_m(self) -> Float[np.ndarray, "s 3"]:
        """All points (s, 3), y running first."""
        x, y = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    @property
    def force_N(self) -> Float[np.ndarray, " s"]:
        """The force of each (s,)."""
        return np.full(len(self.x_m) * len(self.y_m), self.each_N)

    def spread(self, answer: Answer, covariance: Float[np.ndarray, "p p"]) -> ReadingSpread:
        """How uncertain readings are, of what a device with parameters of such a covariance answers to these
        presses.
        """
        by_parameters = answer.slope @ np.linalg.cholesky(covariance) / self.each_N
        shape = (len(self.x_m), len(self.y_m), answer.reading.shape[1], -1)
        return ReadingSpread(self.x_m, self.y_m, by_parameters.reshape(shape))
