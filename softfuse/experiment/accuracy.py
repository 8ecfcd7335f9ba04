"""Errors against truth: Tables I to III of Navarro et al. 2020.

Location error: distance of the estimated from the true contact. Force error: |F − F_true| / F_true. Both over
all samples, over those whose true location lies within the workspace circle, and over each force level.
Position error: distance of the estimated from the true position of a material point.
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

NOWHERE = -1
"""The electrode of a contact that is none."""

PULLED_M = 1e-3
"""A cable that is shorter by more counts as pulled [m]."""


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
        """Masks (s,) of all samples, of those in the workspace circle where it is flat, and of each level."""
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


@dataclass(frozen=True, eq=False)
class ContactSamples:
    """Estimates and truth of contacts at electrodes at the instants that count, with c estimated and t true
    ones: an estimated contact belongs to the true one at the same electrode.

    `level` (s,): which depth, from 1; `electrode` (s, c), `true_electrode` (s, t): where they are, `NOWHERE`
    where there is none; `force_N` (s, c): NaN where there is no estimate; `true_force_N` (s, t): 0 without
    contact.
    """

    level: Int[np.ndarray, " s"]
    electrode: Int[np.ndarray, "s c"]
    force_N: Float[np.ndarray, "s c"]
    true_electrode: Int[np.ndarray, "s t"]
    true_force_N: Float[np.ndarray, "s t"]

    @property
    def true(self) -> Bool[np.ndarray, "s t"]:
        """Where something truly presses on an electrode (s, t)."""
        return (self.true_force_N > 0) & (self.true_electrode != NOWHERE)

    @property
    def _same(self) -> Bool[np.ndarray, "s t c"]:
        same = self.true_electrode[:, :, None] == self.electrode[:, None, :]
        return same & self.true[:, :, None]

    @property
    def matched_N(self) -> Float[np.ndarray, "s t"]:
        """Estimated forces of the true contacts (s, t) [N], NaN where a contact is missed or has none."""
        force = np.where(self._same, self.force_N[:, None, :], 0.0).sum(axis=2)
        return np.where(self._same.any(axis=2), force, np.nan)

    @property
    def force_error(self) -> Float[np.ndarray, "s t"]:
        """|F − F_true| / F_true (s, t) [-], NaN where there is no contact or no estimate."""
        known = np.where(self.true, self.true_force_N, np.nan)
        return np.abs(self.matched_N / known - 1)

    @property
    def missed(self) -> int:
        """How many true contacts no estimated one stands at."""
        return int(np.sum(self.true & ~self._same.any(axis=2)))

    @property
    def misplaced(self) -> int:
        """How many estimated contacts stand where truly nothing presses."""
        return int(np.sum((self.electrode != NOWHERE) & ~self._same.any(axis=1)))


def contact_force_table(samples: ContactSamples) -> dict[str, Spread]:
    """Force error [-] over all true contacts, by number of the contact, then by level."""
    error = samples.force_error
    by_contact = {f"contact{c}": spread(error[:, c]) for c in range(error.shape[1])}
    levels = {f"level_{k}": spread(error[samples.level == k].ravel()) for k in np.unique(samples.level)}
    return {"all": spread(error.ravel())} | by_contact | levels


def largest_force(force_N: Float[np.ndarray, " n"], where: Bool[np.ndarray, " n"]) -> float:
    """Largest of those forces (n,) [N] that are known, among the frames where it counts; NaN if none is: of
    those in which nothing presses, a phantom force.
    """
    known = force_N[where & np.isfinite(force_N)]
    return float(known.max()) if known.size else float("nan")


@dataclass(frozen=True, eq=False)
class ShapeSamples:
    """Estimates and truth of points of the body at the instants that count, each a push held at a depth.

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
