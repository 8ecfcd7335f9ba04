"""Which further press would tell most: the D-optimal one.

A press that reads with slopes J (k, p) and covariance S (k, k) turns the parameters' covariance C into (C⁻¹ +
Jᵀ S⁻¹ J)⁻¹ and gains ½ ln det(I + S⁻¹ J C Jᵀ), in nats. Source: Chaloner and Verdinelli, Stat. Sci. 10 (1995)
273.
"""

import numpy as np
from jaxtyping import Float, Int

from softfuse.calibration.fit import Fit
from softfuse.calibration.presses import Answer
from softfuse.estimation.model_error import missed


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
