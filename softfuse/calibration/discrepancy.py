"""How far a model that is fitted as well as it can be misses what the sensors say.

A reading misses by its noise σ and by what the model does not know, a part δ of its size m
(`estimation.model_error`), alike in the samples of one press. The covariance of a reading's s samples is

    S = diag(σ²) + δ² diag(m) C diag(m),

with C = 1 on the diagonal, ρ between samples of one press, 0 between presses. Source of the idea: Kennedy and
O'Hagan, J. R. Stat. Soc. B 63 (2001) 425.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.calibration.presses import Presses
from softfuse.estimation.model_error import missed, whitening


def alike_in_press(press: Int[np.ndarray, " s"], correlation: float) -> Float[np.ndarray, "s s"]:
    """Correlation matrix C (s, s) of samples that belong to presses (s,)."""
    same = press[:, None] == press
    return correlation * same + (1 - correlation) * np.eye(len(same))


@dataclass(frozen=True)
class Discrepancy:
    """`part` δ [-] of a reading, `alike` ρ [-] in a press: 0.9 to 0.95 make the nominal recording of the
    reference block likeliest, as do floors of 0.03 to 0.05 in `missed`.
    """

    part: float
    alike: float = 0.9

    def whitening(self, presses: Presses) -> "Whitening":
        """What makes misfits of presses standard normal."""
        told, sizes = presses.told, missed(presses.reading, self.part, presses.kind)
        alike = alike_in_press(presses.applied.press, self.alike)
        inverse, ln_det = [], 0.0
        for k in range(told.shape[1]):
            on = told[:, k]
            missing = alike * np.outer(sizes[:, k], sizes[:, k])
            inverse.append(whitening(missing + np.diag(presses.sigma[:, k] ** 2), on))
            ln_det -= 2 * np.sum(np.log(np.diag(inverse[-1])[on]))
        return Whitening(np.array(inverse), float(ln_det))


@dataclass(frozen=True, eq=False)
class Whitening:
    """Inverse Cholesky factors (k, s, s) of each reading's covariance, 0 for what says nothing, and ln det of
    all.
    """

    inverse: Float[np.ndarray, "k s s"]
    ln_det: float

    def of(self, misfit: Float[np.ndarray, "s k ..."]) -> Float[np.ndarray, "s k ..."]:
        """Whitened misfits (s, k, ...) or slopes of them; what is not known takes no part."""
        return np.einsum("kst,tk...->sk...", self.inverse, np.nan_to_num(misfit))
