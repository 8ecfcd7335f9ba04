"""By how much measured and modelled readings may differ: the sensors' noise, what the model misses, and what
it does not know of its parameters.
"""

import zipfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from softfuse.errors import SoftfuseError

_ARRAYS = ("points_m", "by_parameters")

FLOOR = 0.03
"""A reading that is smaller than this part of the largest one is missed as if it were that large, where
nothing else is known: 0.03 to 0.05 make the nominal recording of the reference block likeliest.
"""

_LEVEL = 1e-6
"""So much of their weight keeps slopes of moving least squares small [-]."""

_LARGEST_RATIO = 2.0
"""Beyond so many times the strokes that it was learned at, the offset is not extrapolated [-]."""

_LEAST_STROKE_M = 1e-5
"""Strokes of a smaller norm are none: what is left of them is rounding."""


@dataclass(frozen=True, eq=False)
class ReadingSpread:
    """By how much readings are uncertain because a robot's parameters are: of one contact at some places all
    over a surface, points (s, 3) m, over its force: `by_parameters` (s, k, p): A [1/N]; readings in SI.

    Parameters of covariance B Bᵀ, on which readings depend with slopes J (k, p), make them uncertain by A Aᵀ,
    A = J B, taken to be linear in the force: contacts (c,) with forces F_c at places p_c have A = Σ_c F_c
    a(p_c), since all depend on the same parameters. Between the points a is that of moving least squares,
    exact where it is linear. Source: Lancaster and Salkauskas, Math. Comput. 37 (1981) 141.
    """

    points_m: Float[np.ndarray, "s 3"]
    by_parameters: Float[np.ndarray, "s k p"]

    def covariance(
        self,
        places: Float[np.ndarray, "c 3 3"],
        force_N: Float[np.ndarray, " c"],
    ) -> Float[np.ndarray, "k k"]:
        """Covariance (k, k) of readings for places (c, 3, 3), forces (c,) N."""
        share = force_N @ np.array([self._shares(place) for place in places])
        a = np.einsum("s,skp->kp", share, self.by_parameters)
        return a @ a.T

    @cached_property
    def _pitch_m(self) -> float:
        """How far points are apart."""
        return float(np.median(KDTree(self.points_m).query(self.points_m, 2)[0][:, 1]))

    def _shares(self, place: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " s"]:
        """The share of each point (s,) in what is at a place, 0 where that is not known."""
        if not np.isfinite(place).all():
            return np.zeros(len(self.points_m))
        apart = (self.points_m - place[0]) / self._pitch_m
        square = np.sum(apart**2, axis=1)
        weight = np.exp(-0.5 * (square - square.min()))
        basis = np.column_stack([np.ones(len(apart)), apart @ place[1:].T])
        moments = basis.T @ (weight[:, None] * basis)
        # Points in a row, or a place far from all, tell no slope.
        moments += _LEVEL * moments[0, 0] * np.diag([0, 1, 1])
        return weight * (basis @ np.linalg.solve(moments, [1, 0, 0]))


def write_spread(path: Path, spread: ReadingSpread, **others: np.ndarray) -> None:
    """Write a spread, and arrays that it comes from, as a file of arrays (.npz)."""
    with path.open("wb") as stream:
        arrays: Any = {name: getattr(spread, name) for name in _ARRAYS} | others
        np.savez_compressed(stream, **arrays)


def read_spread(path: Path, readings: int) -> ReadingSpread:
    """The spread in a file, of a robot with so many readings.

    Raises SoftfuseError, which names the file, when it holds none, or another robot's.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            points, by_parameters = (np.asarray(arrays[name], float) for name in _ARRAYS)
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise SoftfuseError(f"{path}: holds no spread of readings: calibrate again ({error})") from error
    shaped = points.ndim == 2 and by_parameters.shape[:2] == (len(points), readings)
    whole = all(np.isfinite(each).all() for each in (points, by_parameters))
    if not (shaped and points.shape[1] == 3 and by_parameters.ndim == 3 and whole and len(points) >= 2):
        raise SoftfuseError(f"{path}: no spread of {readings} readings over points: calibrate again")
    return ReadingSpread(points, by_parameters)


def missed(
    reading: Float[np.ndarray, "*s k"],
    part: float | Float[np.ndarray, " k"],
    kind: Int[np.ndarray, " k"] | None = None,
    floor: float | Float[np.ndarray, " k"] = FLOOR,
) -> Float[np.ndarray, "*s k"]:
    """Standard deviations (..., k) of what the model misses of readings (..., k), in their units: a part [-]
    of √(y² + (φ y_max)²), φ the `floor`, y_max the largest of its `kind` (k,), such as those of one sensor,
    or of all; part and floor of each reading (k,), or the same of all. A reading that is NaN counts as 0.
    """
    size = np.nan_to_num(np.abs(reading))
    largest = np.zeros_like(size)
    kind = np.zeros(size.shape[-1], int) if kind is None else kind
    for each in np.unique(kind):
        own = kind == each
        largest[..., own] = size[..., own].max(axis=-1, keepdims=True)
    return part * np.hypot(size, floor * largest)


@dataclass(frozen=True, eq=False)
class ModelError:
    """`part` [-] of each reading (k,), or of all, by which the model may be wrong, for each by itself;
    `alike` [-] for all together, as where its stiffness is not known; the spread of its parameters, if known;
    the `kind` (k,) of each reading, None: all of one; and the `floor` [-], see `missed`.
    """

    part: float | Float[np.ndarray, " k"] = 0.0
    alike: float = 0.0
    spread: ReadingSpread | None = None
    kind: Int[np.ndarray, " k"] | None = None
    floor: float | Float[np.ndarray, " k"] = FLOOR

    def covariance(
        self,
        reading: Float[np.ndarray, " k"],
        sigma: Float[np.ndarray, " k"],
        places: np.ndarray,
        force_N: Float[np.ndarray, " c"],
    ) -> Float[np.ndarray, "k k"]:
        """Covariance (k, k) of measured minus modelled readings (k,) with sensors' noise (k,), under contacts
        at places (c, 3, 3) with forces (c,) N.
        """
        covariance = self.without_contacts(reading, sigma)
        if self.spread is not None:
            covariance += self.spread.covariance(places, force_N)
        return covariance

    def without_contacts(
        self, reading: Float[np.ndarray, " k"], sigma: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k k"]:
        """Covariance (k, k) of measured minus modelled readings (k,) with sensors' noise (k,) where nothing
        presses.
        """
        own = np.diag(sigma**2 + missed(reading, self.part, self.kind, self.floor) ** 2)
        return own + self.alike**2 * np.outer(reading, reading)


AS_DRAWN = ModelError(part=0.1, alike=0.2)
"""Of a model that has not been compared with presses: silicones of one name differ more, but who makes a
robot measures its modulus.
"""


def assumed(error: ModelError | None, kind: Int[np.ndarray, " k"], *, alone: bool) -> ModelError:
    """By how much a model may be wrong about readings of such kinds (k,); of one about whose errors nothing
    is known, None, where the readings tell of a contact `alone`, as it is drawn, and else by nothing.
    """
    return replace(error or (AS_DRAWN if alone else ModelError()), kind=kind)


def lasting(
    error: ModelError | None,
    reading: Float[np.ndarray, " k"],
    sigma: Float[np.ndarray, " k"],
    places: Float[np.ndarray, "c 3 3"],
    force_N: Float[np.ndarray, " c"],
) -> Float[np.ndarray, "k k"]:
    """Covariance (k, k) of what does not change while the contacts stay, without the sensors' noise;
    arguments as those of `ModelError.covariance`. Of a model about whose errors nothing is known, None, or
    only what sensors say, a tenth of the largest reading, in standard deviations, whichever it is of: so
    readings weigh as they do in a frame.
    """
    if error is None or (not np.any(error.part) and error.spread is None):
        return np.diag((AS_DRAWN.part * np.max(np.abs(reading) / sigma, initial=0.0) * sigma) ** 2)
    return error.covariance(reading, np.zeros_like(sigma), places, force_N)


def whitening(
    covariance: Float[np.ndarray, "k k"], valid: Bool[np.ndarray, " k"]
) -> Float[np.ndarray, "k k"]:
    """L⁻¹ (k, k) of the covariance L Lᵀ of the valid readings (k,), zeros for the others."""
    inverse = np.zeros_like(covariance)
    on = np.ix_(valid, valid)
    inverse[on] = np.linalg.inv(np.linalg.cholesky(covariance[on]))
    return inverse


@dataclass(frozen=True, eq=False)
class ModelOffset:
    """What the model misses while nothing is near: learned then, and taken off the readings of a touch.

    The offset b₀ (k,) of the readings, in their units, learned at strokes of norm |c₀| [m]. A body that is
    not quite its model answers its cables with other readings. While nothing is near, the difference is seen
    with no contact's force in it. It grows with the cables' strokes c, so that later b = b₀ |c| / |c₀|. It
    also holds what the sensors' zeros are off.
    """

    reading: Float[np.ndarray, " k"]
    stroke: float

    @classmethod
    def none(cls, readings: int) -> "ModelOffset":
        """Nothing has been learned of so many readings."""
        return cls(np.zeros(readings), 0.0)

    def at(self, stroke: float) -> Float[np.ndarray, " k"]:
        """b (k,) at strokes of a norm in m; b₀ where nothing was pulled when it was learned."""
        ratio = stroke / self.stroke if self.stroke > _LEAST_STROKE_M else 1.0
        return self.reading * min(ratio, _LARGEST_RATIO)

    def learned(
        self, misfit: Float[np.ndarray, " k"], known: Bool[np.ndarray, " k"], stroke: float, share: float
    ) -> "ModelOffset":
        """With a share [-] of measured minus modelled readings (k,) in it; those not known keep theirs."""
        before = self.at(stroke)
        return ModelOffset(np.where(known, before + share * (misfit - before), before), stroke)
