"""Limits of measures, and how much room they leave: not negative where all are kept."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.design.objective import AbstractMeasure


@dataclass(frozen=True, eq=False)
class Limit:
    """What a measure must be at least and at most, in SI; infinite where it need not."""

    measure: AbstractMeasure
    at_least: float = -np.inf
    at_most: float = np.inf


def room(limits: Sequence[Limit], measures: Float[np.ndarray, " l"]) -> Float[np.ndarray, " r"]:
    """By how much (r,) the limits' measures (l,) are within each finite bound, in parts of the bound."""
    return np.array([sign * (measures[k] - bound) / abs(bound) for k, sign, bound in _bounds(limits)])


def room_slopes(limits: Sequence[Limit], slopes: Float[np.ndarray, "l p"]) -> Float[np.ndarray, "r p"]:
    """The derivatives (r, p) of `room`, from those (l, p) of the measures."""
    rows = [sign * slopes[k] / abs(bound) for k, sign, bound in _bounds(limits)]
    return np.array(rows).reshape(-1, slopes.shape[1])


def _bounds(limits: Sequence[Limit]) -> Iterator[tuple[int, float, float]]:
    for k, limit in enumerate(limits):
        for sign, bound in ((1.0, limit.at_least), (-1.0, limit.at_most)):
            if np.isfinite(bound):
                yield k, sign, bound
