"""The place of a contact from one frame to the next.

State (p, b) for x and for y: where it is, and by how much what sees it is off during a touch. A frame sees p
+ b + v. p walks slowly, or where a frame contradicts that, fast. What contradicts that as well is taken for
an outlier, and if it lasts longer than `Process.patience_s`, for a contact that has gone there.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from softfuse.estimation.smoothing.normal import Change, Normal, Reading, Step
from softfuse.estimation.smoothing.process import Process

_PLACE = slice(0, 2)
_ANYWHERE_M = 1.0
"""Standard deviation of where a contact may have gone."""


class PlaceStep(NamedTuple):
    """A frame's step, whether what it saw is an outlier, and for how long [s] that has been so."""

    step: Step
    outlier: bool = False
    since_s: float = 0.0


def begun(process: Process, seen_m: Float[np.ndarray, "2"], sigma_m: Float[np.ndarray, "2"]) -> PlaceStep:
    """With what the first frame saw, x and y (2,) m of standard deviations (2,) m."""
    off = np.diag((1 - process.white) * sigma_m**2)
    white = np.diag(process.white * sigma_m**2)
    covariance = np.block([[off + white, -off], [-off, off]])
    known = Normal(np.append(seen_m, np.zeros(2)), covariance)
    return PlaceStep(Step(Change(np.eye(4), np.zeros((4, 4))), known, known))


def gone_on(
    process: Process,
    before: PlaceStep,
    dt_s: float,
    seen_m: Float[np.ndarray, "2"],
    sigma_m: Float[np.ndarray, "2"],
) -> PlaceStep:
    """The next frame, dt_s [s] later, with what it saw (2,) m of standard deviations (2,) m; NaN: nothing."""
    still, moved = _walk(process.still_m, dt_s), _walk(process.moving_m, dt_s)
    known = before.step.known
    if not np.isfinite([seen_m, sigma_m]).all():
        later = known.gone_on(still)
        return before._replace(step=Step(still, later, later), outlier=False)
    rows = np.hstack([np.eye(2), np.eye(2)])
    reading = Reading(seen_m, rows, np.sqrt(process.white) * sigma_m)
    for change in (still, moved):
        later = known.gone_on(change)
        if not process.surprising(later.surprise(reading), 2):
            return PlaceStep(Step(change, later, later.updated(reading)))
    since_s = before.since_s + dt_s if before.outlier else 0.0
    if since_s < process.patience_s or not before.outlier:
        later = known.gone_on(still)
        return PlaceStep(Step(still, later, later), outlier=True, since_s=since_s)
    anywhere = Change(np.eye(4), np.diag([_ANYWHERE_M, _ANYWHERE_M, 0.0, 0.0]) ** 2)
    later = known.gone_on(anywhere)
    return PlaceStep(Step(anywhere, later, later.updated(reading)))


def place(known: Normal) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """x and y (2,) m, and their standard deviations (2,) m."""
    return known.mean[_PLACE], np.sqrt(np.maximum(np.diag(known.covariance)[_PLACE], 0.0))


def _walk(rate_m: float, dt_s: float) -> Change:
    noise = np.zeros((4, 4))
    noise[_PLACE, _PLACE] = rate_m**2 * dt_s * np.eye(2)
    return Change(np.eye(4), noise)
