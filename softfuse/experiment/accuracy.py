"""Location and force errors against truth: Tables I and II of Navarro et al. 2020.

Location error: distance of the estimated from the true contact. Force error: |F − F_true| / F_true. Both over
all samples, over those whose true location lies within the workspace circle, and over each force level.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

T = TypeVar("T", bound=Any)

WORKSPACE_CIRCLE_M = 28e-3
"""Radius of the paper's workspace circle [m]."""

NINETY = 1.645
"""Standard deviations to each side that hold 90 % of a normal distribution."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Estimates and truth at the instants that count: level (s,) from 1, location (s, d) [m] along x and y,
    or x, y and z, force (s,) [N], and the standard deviations of both.

    NaN where there is no estimate, or its standard deviation is not known.
    """

    level: Int[np.ndarray, " s"]
    location_m: Float[np.ndarray, "s d"]
    force_N: Float[np.ndarray, " s"]
    true_location_m: Float[np.ndarray, "s d"]
    true_force_N: Float[np.ndarray, " s"]
    location_sigma_m: Float[np.ndarray, "s d"]
    force_sigma_N: Float[np.ndarray, " s"]

    @property
    def location_error_m(self) -> Float[np.ndarray, " s"]:
        """Distance from the truth (s,) [m]."""
        return np.linalg.norm(self.location_m - self.true_location_m, axis=1)

    @property
    def force_error(self) -> Float[np.ndarray, " s"]:
        """|F − F_true| / F_true (s,) [-]."""
        return np.abs(self.force_N / self.true_force_N - 1)

    def only(self, which: Bool[np.ndarray, " s"]) -> "Samples":
        """Those of the samples for which it holds (s,)."""
        return Samples(*(getattr(self, each.name)[which] for each in fields(self)))

    def groups(self) -> dict[str, np.ndarray]:
        """Masks (s,) of all samples, those in the workspace circle where that is flat, and those of each
        level.
        """
        every = np.ones(len(self.level), bool)
        levels = {f"level_{k}": self.level == k for k in np.unique(self.level)}
        if self.true_location_m.shape[1] != 2:
            return {"all": every, **levels}
        circle = np.linalg.norm(self.true_location_m, axis=1) <= WORKSPACE_CIRCLE_M
        return {"all": every, "circle": circle, **levels}


def together(parts: Sequence[T]) -> T:
    """All samples of one or more parts, dataclasses of one kind whose fields are arrays (s, ...)."""
    kind = type(parts[0])
    return kind(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(kind)))


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


def coverage(samples: Samples) -> dict[str, float]:
    """In which part [-] of the samples of known standard deviation the truth lies within the 90 % interval of
    the estimate, of force, x and y; NaN where none is known.
    """
    off = (samples.location_m - samples.true_location_m) / samples.location_sigma_m
    ratio = {"force": (samples.force_N - samples.true_force_N) / samples.force_sigma_N}
    ratio |= {axis: off[:, k] for k, axis in enumerate("xyz"[: off.shape[1]])}
    return {
        name: spread((np.abs(r) < NINETY)[np.isfinite(r)].astype(float)).mean for name, r in ratio.items()
    }


def scaled(groups: dict[str, Spread], factor: float) -> dict[str, Spread]:
    """A table in another unit."""
    return {name: each.scaled(factor) for name, each in groups.items()}
