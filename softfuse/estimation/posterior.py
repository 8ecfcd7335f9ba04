"""How sure an estimate is of its drives and of the places that it moved."""

import numpy as np
from jaxtyping import Float

from softfuse.estimation.estimator import Estimate
from softfuse.estimation.limits import Limits


def posterior_covariance(found: Estimate, limits: Limits) -> Float[np.ndarray, "DP DP"]:
    """Covariance (D + P, D + P) of the drives of an estimate and of the numbers η of places that were not
    known, of those within their limits the inverse of their information.

    A drive that is held at a limit has the variance that it would have alone, if it could move: by so much
    the readings let it be wrong; one that has no room has none.
    """
    lower, upper = np.asarray(limits.lower), np.asarray(limits.upper)
    information, room = found.report.information, 1e-9 * (upper - lower)
    places = np.ones(len(information) - len(upper), bool)
    movable = upper > lower
    within = movable & (found.drive > lower + room) & (found.drive < upper - room)
    free = np.append(within, places)
    alone = np.where(np.append(movable & ~within, ~places), 1 / np.diag(information), 0.0)
    covariance = np.diag(alone)
    covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
    return covariance
