"""Which of several contacts that were found is which of those that truly are there: those that are nearest
together.

In each sample true and found contacts are assigned one to one so that the sum of their distances is least,
where those that are too far apart count the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment

from softfuse.estimation.tracked import Tracked
from softfuse.experiment.accuracy import Samples
from softfuse.report.truth import Truth

_FAR_M = 20e-3
"""Further apart, one is missed and the other found where nothing presses."""


@dataclass(frozen=True, eq=False)
class MatchedContacts:
    """The true contacts of the samples with those that were found nearest; `true` (s, t): where one presses;
    how many nothing was found of, `missed`, and how many were found elsewhere, `misplaced`.
    """

    samples: Samples
    true: Bool[np.ndarray, "s t"]
    missed: int
    misplaced: int


def matched_contacts(found: Sequence[Tracked], truth: Truth, slots: Sequence[str]) -> MatchedContacts | None:
    """Of contacts in slots with these names; None where the truth does not know each one's place."""
    known = [slot for slot in slots if f"{slot}_x_mm" in truth.columns and f"{slot}_force_N" in truth.columns]
    if not known:
        return None
    axes = [axis for axis in "xyz" if all(f"{slot}_{axis}_mm" in truth.columns for slot in known)]
    places = np.stack([[1e-3 * truth.get(f"{s}_{a}_mm") for a in axes] for s in known]).transpose(2, 0, 1)
    forces = np.stack([truth.get(f"{slot}_force_N") for slot in known], axis=1)
    at = np.flatnonzero(truth.level > 0)
    pressed = (forces[at] > 0) & np.isfinite(places[at]).all(axis=2)
    if not pressed.any():
        return None
    used = ["xyz".index(axis) for axis in axes]
    rows, missed, misplaced = [], 0, 0
    for i, true in zip(at.tolist(), pressed, strict=True):
        now = found[i]
        there = np.flatnonzero(now.touching & np.isfinite(now.location_m).all(axis=1))
        which = _assigned(places[i, true], now.location_m[there][:, used])
        misplaced += len(there) - sum(k is not None for k in which)
        missed += sum(k is None for k in which)
        for t, k in zip(np.flatnonzero(true), which, strict=True):
            c = None if k is None else int(there[k])
            rows.append((truth.level[i], *_row(now, c, used), places[i, t], forces[i, t]))
    level, location, sigma, force, force_sigma, true_at, true_N = (
        np.array(each) for each in zip(*rows, strict=True)
    )
    samples = Samples(level, location, force, true_at, true_N, sigma, force_sigma)
    return MatchedContacts(samples, pressed, missed, misplaced)


def _assigned(true: Float[np.ndarray, "t d"], found: Float[np.ndarray, "c d"]) -> list[int | None]:
    """The number of that of the found places which is each true one's (t,), None where there is none."""
    apart = np.linalg.norm(true[:, None] - found, axis=2)
    # How far apart those are that are none does not matter.
    pairs = dict(zip(*linear_sum_assignment(np.minimum(apart, _FAR_M)), strict=True))
    return [int(pairs[t]) if t in pairs and apart[t, pairs[t]] < _FAR_M else None for t in range(len(true))]


def _row(
    now: Tracked, contact: int | None, axes: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Place and its standard deviation, force and its standard deviation of a contact, NaN without one."""
    if contact is None:
        nowhere = np.full(len(axes), np.nan)
        return nowhere, nowhere, np.nan, np.nan
    at, sigma = now.location_m[contact][axes], now.axis_sigma_m[contact][axes]
    return at, sigma, float(now.contact_force_N[contact]), float(now.contact_sigma_N[contact])
