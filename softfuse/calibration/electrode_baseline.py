"""What electrodes read while nothing is near: the median over frames, which a hovering hand hardly moves."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

_LEAST_FRAMES = 50
"""Fewer readings of a line say nothing."""


@dataclass(frozen=True, eq=False)
class Untouched:
    """Counts (e,) of electrodes and standard deviations (e,) of single readings about them, by noise and by
    drift while they were recorded.
    """

    counts: Float[np.ndarray, " e"]
    sigma: Float[np.ndarray, " e"]


def untouched(counts: Float[np.ndarray, "n e"], read: Bool[np.ndarray, "n e"]) -> Untouched | None:
    """What n frames of counts (n, e) say of which some are read with nothing near (n, e); None when there are
    too few of some electrode.
    """
    if np.any(read.sum(axis=0) < _LEAST_FRAMES):
        return None
    there = np.where(read, counts, np.nan)
    return Untouched(np.nanmedian(there, axis=0), np.nanstd(there, axis=0))
