"""Amplitudes of modes from a few of the full body's unknowns, those that tell the modes apart.

When a contact goes from one chart to the next, its state does too. The amplitudes that come closest to it in
energy ask for every unknown of the full body, a few milliseconds; a few hundred unknowns, matched by least
squares, give amplitudes that differ by less than the charts do. Source for the choice by pivoted QR: Drmač
and Gugercin, SIAM J. Sci. Comput. 38, 2016 (Q-DEIM).
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

_ROUNDS = 2
"""Times as many unknowns as modes, so that what no mode makes is averaged."""


class Telling(NamedTuple):
    """Which `unknowns` (s,) of the full body, and the amplitudes `of_them` (r, s)."""

    unknowns: Int[np.ndarray, " s"]
    of_them: Float[np.ndarray, "r s"]


def telling_unknowns(modes: Float[np.ndarray, "u r"]) -> Int[np.ndarray, " s"]:
    """The rows (s,) of modes that tell these apart best: pivots of them all, then of those that are left."""
    chosen = np.zeros(0, int)
    for _ in range(_ROUNDS):
        left = np.setdiff1d(np.arange(len(modes)), chosen)
        pivots = np.asarray(scipy.linalg.qr(modes[left].T, mode="r", pivoting=True)[-1])
        chosen = np.append(chosen, left[pivots[: modes.shape[1]]])
    return chosen


def telling(modes: Float[np.ndarray, "u r"], unknowns: Int[np.ndarray, " s"]) -> Telling:
    """Amplitudes of modes from the unknowns (s,) that tell them apart."""
    return Telling(unknowns, np.linalg.pinv(modes[unknowns].astype(float)))
