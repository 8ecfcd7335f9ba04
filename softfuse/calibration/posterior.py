"""What presses say of parameters with normal priors."""

from abc import ABC

import numpy as np
from jaxtyping import Float

from softfuse.calibration.adjustment import Measure


class AbstractPosterior(ABC):
    """p parameters with `names` and `measures`: `value` (p,), `covariance` (p, p) and `prior_sigma` (p,) in
    the units of their measures.
    """

    names: tuple[str, ...]
    measures: tuple[Measure, ...]
    value: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    prior_sigma: Float[np.ndarray, " p"]

    @property
    def sigma(self) -> Float[np.ndarray, " p"]:
        """Standard deviations (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> Float[np.ndarray, " p"]:
        """How much of each parameter the presses tell (p,): 0 nothing beyond the prior, 1 all of it."""
        return 1 - (self.sigma / self.prior_sigma) ** 2

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Of the parameters (p, p)."""
        return self.covariance / np.outer(self.sigma, self.sigma)
