"""Which further press would tell most: the D-optimal one.

A press that reads with slopes J (k, p) and covariance S (k, k) turns the parameters' covariance C into (C⁻¹ +
Jᵀ S⁻¹ J)⁻¹ and gains ½ ln det(I + S⁻¹ J C Jᵀ), nats. Source: Chaloner, Verdinelli, Stat. Sci. 10 (1995) 273.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.calibration.fit import Fit
from softfuse.calibration.presses import Answer
from softfuse.estimation.model_error import ReadingSpread, missed

_SIDE = 11
"""Places in each direction."""


def gain(
    fit: Fit, answer: Answer, noise: Float[np.ndarray, " k"], kind: Int[np.ndarray, " k"]
) -> Float[np.ndarray, " s"]:
    """What each of s further presses would tell [nat], whose answers are those of the fitted parameters;
    `noise` (k,): standard deviations of the readings, in their SI units; `kind` (k,): see
    `model_error.missed`.
    """
    sigma = np.hypot(noise, missed(answer.reading, fit.discrepancy.part, kind))
    whitened = answer.slope / sigma[..., None]
    seen = np.einsum("skp,pq,slq->skl", whitened, fit.covariance, whitened)
    return 0.5 * np.linalg.slogdet(np.eye(seen.shape[1]) + seen)[1]


@dataclass(frozen=True, eq=False)
class Grid:
    """Places of x (a,) and y (b,) [m] all over a workspace, all to be pressed with one force [N]."""

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

    def spread(self, answer: Answer, covariance: Float[np.ndarray, "p p"]) -> ReadingSpread:
        """How uncertain readings are, as a device answers these presses with parameters so uncertain."""
        by_parameters = answer.slope @ np.linalg.cholesky(covariance) / self.each_N
        shape = (len(self.x_m), len(self.y_m), answer.reading.shape[1], -1)
        return ReadingSpread(self.x_m, self.y_m, by_parameters.reshape(shape))
