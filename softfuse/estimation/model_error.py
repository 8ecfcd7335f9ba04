"""By how much measured and modelled readings may differ: the sensors' noise, what the model misses, and what
it does not know of its parameters.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.estimation.reading_spread import ReadingSpread

FLOOR = 0.03
"""A reading that is smaller than this part of the largest one is missed as if it were that large."""


def missed(
    reading: Float[np.ndarray, "*s k"], part: float, kind: Int[np.ndarray, " k"] | None = None
) -> Float[np.ndarray, "*s k"]:
    """Standard deviations (..., k) of what the model misses of readings (..., k), in their units: a part [-]
    of √(y² + (φ y_max)²), y_max the largest of its `kind` (k,), such as those of one sensor, or of all. A
    reading that is NaN counts as 0.
    """
    size = np.nan_to_num(np.abs(reading))
    largest = np.zeros_like(size)
    kind = np.zeros(size.shape[-1], int) if kind is None else kind
    for each in np.unique(kind):
        own = kind == each
        largest[..., own] = size[..., own].max(axis=-1, keepdims=True)
    return part * np.hypot(size, FLOOR * largest)


@dataclass(frozen=True, eq=False)
class ModelError:
    """`part` [-] of each reading by which the model may be wrong, for each by itself, `alike` [-] for all
    together, as where its stiffness is not known; the spread of its parameters, if known; and the `kind` (k,)
    of each reading, see `missed`, None: all of one.
    """

    part: float = 0.0
    alike: float = 0.0
    spread: ReadingSpread | None = None
    kind: Int[np.ndarray, " k"] | None = None

    def covariance(
        self,
        reading: Float[np.ndarray, " k"],
        sigma: Float[np.ndarray, " k"],
        places: np.ndarray,
        force_N: Float[np.ndarray, " c"],
    ) -> Float[np.ndarray, "k k"]:
        """Covariance (k, k) of measured minus modelled readings (k,) with sensors' noise (k,), under contacts
        at places (c, 3, 3) with forces (c,) N.
        """
        covariance = np.diag(sigma**2 + missed(reading, self.part, self.kind) ** 2)
        covariance += self.alike**2 * np.outer(reading, reading)
        if self.spread is not None:
            covariance += self.spread.covariance(places, force_N)
        return covariance

    def lasting(
        self,
        reading: Float[np.ndarray, " k"],
        sigma: Float[np.ndarray, " k"],
        places: np.ndarray,
        force_N: Float[np.ndarray, " c"],
    ) -> Float[np.ndarray, "k k"]:
        """Covariance (k, k) of what does not change while the contacts stay, without the sensors' noise;
        arguments as those of `covariance`. Of a model about whose errors nothing is known, a tenth of the
        largest reading, in standard deviations, whichever it is of: so readings weigh as they do in a frame.
        """
        if self.part == 0 and self.spread is None:
            return np.diag((AS_DRAWN.part * np.max(np.abs(reading) / sigma, initial=0.0) * sigma) ** 2)
        return self.covariance(reading, np.zeros_like(sigma), places, force_N)


AS_DRAWN = ModelError(part=0.1, alike=0.2)
"""Of a model that has not been compared with presses: silicones of one name differ more, but who makes a
device measures its modulus.
"""


def whitening(
    covariance: Float[np.ndarray, "k k"], valid: Bool[np.ndarray, " k"]
) -> Float[np.ndarray, "k k"]:
    """L⁻¹ (k, k) of the covariance L Lᵀ of the valid readings (k,), zeros for the others."""
    inverse = np.zeros_like(covariance)
    on = np.ix_(valid, valid)
    inverse[on] = np.linalg.inv(np.linalg.cholesky(covariance[on]))
    return inverse
