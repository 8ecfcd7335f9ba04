"""Location and force errors against truth: Tables I and II of Navarro et al. 2020.

Location error: distance of the estimated from the true contact. Force error: |F − F_true| / F_true. Both over
all samples, over those whose true location lies within the workspace circle, and over each force level.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

WORKSPACE_CIRCLE_M = 28e-3
"""Radius of the paper's workspace circle [m]."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Estimates and truth at the instants that count: level (s,) from 1, location (s, 2) [m], force (s,) [N].

    NaN where there is no estimate.
    """

    level: Int[np.ndarray, " s"]
    location_m: Float[np.ndarray, "s 2"]
    force_N: Float[np.ndarray, " s"]
    true_location_m: Float[np.ndarray, "s 2"]
    true_force_N: Float[np.ndarray, " s"]

    @property
    def location_error_m(self) -> Float[np.ndarray, " s"]:
        """Distance from the truth (s,) [m]."""
        return np.linalg.norm(self.location_m - self.true_location_m, axis=1)

    @property
    def force_error(self) -> Float[np.ndarray, " s"]:
        """|F − F_true| / F_true (s,) [-]."""
        return np.abs(self.force_N / self.true_force_N - 1)

    def groups(self) -> dict[str, np.ndarray]:
        """Masks (s,) of all samples, those in the workspace circle, and those of each level."""
        every = np.ones(len(self.level), bool)
        circle = np.linalg.norm(self.true_location_m, axis=1) <= WORKSPACE_CIRCLE_M
        levels = {f"level_{k}": self.level == k for k in np.unique(self.level)}
        return {"all": every, "circle": circle, **levels}


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation over n samples that have an estimate; NaN when none has."""

    mean: float
    std: float
    n: int

    def scaled(self, factor: float) -> "Spread":
        """The same in another unit: mean and deviation times the factor."""
        return Spread(factor * self.mean, factor * self.std, self.n)


def spread(values: Float[np.ndarray, " s"]) -> Spread:
    """Mean and standard deviation of those of the values (s,) that are not NaN."""
    known = values[np.isfinite(values)]
    if not known.size:
        return Spread(float("nan"), float("nan"), 0)
    return Spread(float(known.mean()), float(known.std()), known.size)


def location_table(samples: Samples) -> dict[str, Spread]:
    """Table I: location error [m] by group."""
    return {name: spread(samples.location_error_m[mask]) for name, mask in samples.groups().items()}


def force_table(samples: Samples) -> dict[str, Spread]:
    """Table II: force error [-] by group."""
    return {name: spread(samples.force_error[mask]) for name, mask in samples.groups().items()}


def scaled(groups: dict[str, Spread], factor: float) -> dict[str, Spread]:
    """A table in another unit."""
    return {name: each.scaled(factor) for name, each in groups.items()}
