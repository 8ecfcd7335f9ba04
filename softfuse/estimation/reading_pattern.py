"""Where readings alone say that something presses: their pattern, compared with that of presses all over.

A press with a small force F at a place p changes the readings by F w(p), w = ∂s/∂F of the robot as it is
(`push_response`). Of readings y that nothing else explains, with errors of covariance L Lᵀ, the place where

    χ²(p) = min over F ≥ 0 of |L⁻¹ (y − F w(p))|²

is least explains them best. That is rough, as under larger forces patterns change, but it finds the region
from which the estimate's own steps go on to the place itself, and tells of others that the readings do not
rule out: presses there have a share of exp(−χ²/2) over that of all.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.estimation.model_error import missed, whitening

_CHANGED = 0.05
"""Part of a reading by which the pattern of a small force may be off that of a large one."""
_CLEARLY = 9.0
"""By how much χ² has to be less elsewhere for the search to begin anew there."""


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
) -> "PatternFit":
    """How well a press at each place (s, 3, 3), `pitch_m` (2,) apart, with readings per newton (s, k) [SI/N]
    explains valid readings (k,) of a covariance (k, k) and of so many kinds (k,), see `model_error.missed`.
    """
    reading = np.where(valid, reading, 0.0)
    white = whitening(covariance + np.diag(missed(reading, _CHANGED, kind) ** 2), valid)
    seen, slope = white @ reading, slope @ white.T
    size = np.maximum(np.sum(slope**2, axis=1), np.finfo(float).tiny)
    force = np.maximum(slope @ seen, 0.0) / size
    return PatternFit(places, pitch_m, force, seen @ seen - force**2 * size, float(seen @ seen))


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
    χ² (s,); and χ² without any.
    """

    place: Float[np.ndarray, "s 3 3"]
    pitch_m: Float[np.ndarray, "2"]
    force_N: Float[np.ndarray, " s"]
    missing: Float[np.ndarray, " s"]
    unexplained: float

    @property
    def best(self) -> int:
        """The number of the place that explains them best."""
        return int(np.argmin(self.missing))

    def better(self, place: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"] | None:
        """The best place (3, 3), None where it is not clearly better than another one (3, 3)."""
        here = np.argmin(np.sum((self.place[:, 0] - place[0]) ** 2, axis=1))
        return self.place[self.best] if self.missing[here] - self.missing[self.best] > _CLEARLY else None

    def elsewhere(self, place: Float[np.ndarray, "3 3"], force_N: float) -> Elsewhere:
        """Presses that explain the readings too, further than the grid's pitch from one at a place (3, 3)
        with a force [N].
        """
        off = offsets(place, self.place)
        away = np.linalg.norm(self.place[:, 0] - place[0], axis=1) > np.linalg.norm(self.pitch_m)
        away |= np.any(np.abs(off) > self.pitch_m, axis=1)
        part = np.exp(-0.5 * (self.missing - self.missing.min()))
        part = np.where(away, part / part.sum(), 0.0)
        share = part.sum()
        part = part / max(share, np.finfo(float).tiny)
        return Elsewhere(float(share), part @ off**2, float(part @ (self.force_N - force_N) ** 2))
