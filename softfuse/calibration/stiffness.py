"""One scalar for the whole body's stiffness, from estimated and true forces.

All moduli times k and all dead loads times k leave the shape as it is, so the force that explains measured
volumes is proportional to k, exactly and for any deformation. Its best value in the sense of relative errors,
k = argmin Σ_s (k r_s − 1)² with r = F_estimated / F_true, is Σ r / Σ r².
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import SoftfuseError


@dataclass(frozen=True)
class StiffnessFit:
    """The factor on all moduli [-], its standard error [-], and how many samples it rests on."""

    factor: float
    standard_error: float
    n: int


def fit_stiffness(estimated_N: Float[np.ndarray, " s"], true_N: Float[np.ndarray, " s"]) -> StiffnessFit:
    """Fit the factor to forces (s,) [N] estimated and true; an estimate that is NaN or 0 says nothing.

    Raises SoftfuseError when no sample is left.
    """
    used = np.isfinite(estimated_N) & (estimated_N > 0) & (true_N > 0)
    if not used.any():
        raise SoftfuseError(
            "no sample of the chosen presses has an estimate within the force limit: choose other presses"
        )
    ratio = estimated_N[used] / true_N[used]
    square = float(np.sum(ratio**2))
    factor = float(np.sum(ratio)) / square
    left = float(np.sum((factor * ratio - 1) ** 2)) / max(len(ratio) - 1, 1)
    return StiffnessFit(factor, float(np.sqrt(left / square)), len(ratio))
