"""Position errors of material points against truth: Table III of Navarro et al. 2020.

A row is one push held at one depth: for each point the distance of its estimated from its true position.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.experiment.accuracy import Spread, spread

PULLED_M = 1e-3
"""A cable that is shorter by more counts as pulled [m]."""


@dataclass(frozen=True, eq=False)
class ShapeSamples:
    """Estimates and truth at the instants that count.

    `press`, `level` (s,): which push, and which depth of it, from 1; `cable_m` (s,): shortening of the cable,
    NaN where it is not known; `position_m`, `true_position_m` (s, p, 3): of p points, NaN where there is no
    estimate.
    """

    press: Int[np.ndarray, " s"]
    level: Int[np.ndarray, " s"]
    cable_m: Float[np.ndarray, " s"]
    position_m: Float[np.ndarray, "s p 3"]
    true_position_m: Float[np.ndarray, "s p 3"]

    @property
    def error_m(self) -> Float[np.ndarray, "s p"]:
        """Distances from the truth (s, p) [m]."""
        return np.linalg.norm(self.position_m - self.true_position_m, axis=2)

    def groups(self) -> dict[str, np.ndarray]:
        """Masks (s,) of all rows, those with and without a pulled cable, and those of each depth."""
        pulled = self.cable_m > PULLED_M
        every = np.ones(len(self.level), bool)
        levels = {f"level_{k}": self.level == k for k in np.unique(self.level)}
        return {"all": every, "with_cable": pulled, "without_cable": ~pulled, **levels}


def position_table(samples: ShapeSamples, names: list[str]) -> dict[str, Spread]:
    """Table III: position error [m] by group over all points, then over all rows by point."""
    error = samples.error_m
    groups = {name: spread(error[mask].ravel()) for name, mask in samples.groups().items()}
    return groups | {name: spread(error[:, k]) for k, name in enumerate(names)}
