"""A material curve at rest: straight between given points, measured by its arc length from the first one."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError

_SAME = 1e-9  # of a piece: elements whose common part of it is shorter only touch it


@dataclass(frozen=True, eq=False)
class Polyline:
    """Points (p, 3) m and their arc lengths (p,) m from the first."""

    points: Float[np.ndarray, "p 3"]
    arc: Float[np.ndarray, " p"]

    @classmethod
    def through(cls, points: Float[np.ndarray, "p 3"]) -> "Polyline":
        """The curve through two or more points (p, 3) m; MeshError for fewer, or two at the same place."""
        given = np.asarray(points, float).reshape(-1, 3)
        steps = np.linalg.norm(np.diff(given, axis=0), axis=1)
        if not len(steps) or not np.all(steps > 0):
            raise MeshError("a line needs two points or more, each at another place than the one before")
        return cls(given, np.append(0.0, np.cumsum(steps)))

    @property
    def length(self) -> float:
        """Of the whole curve [m]."""
        return float(self.arc[-1])

    def at(self, arc: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k 3"]:
        """Points (..., 3) m at arc lengths (...) m."""
        return np.stack([np.interp(arc, self.arc, self.points[:, k]) for k in range(3)], axis=-1)

    def tangent(self, arc: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k 3"]:
        """Unit tangents (..., 3) at arc lengths (...) m; of the piece behind, at a corner."""
        piece = np.clip(np.searchsorted(self.arc, arc, side="right") - 1, 0, len(self.arc) - 2)
        return np.diff(self.points, axis=0)[piece] / np.diff(self.arc)[piece][..., None]

    def crossings(self, body: AbstractBody) -> list[Float[np.ndarray, " b"]]:
        """For each straight piece, the arc lengths (b,) m of its ends and of where it passes from element to
        element of a body at rest, in ascending order: with straight edges exactly.
        """
        corner = np.asarray(body.rest)[np.asarray(body.tets)[:, :4]]
        inverse = np.linalg.inv(np.swapaxes(corner[:, 1:] - corner[:, :1], 1, 2))
        local = np.einsum("eij,pej->pei", inverse, self.points[:, None] - corner[:, 0])
        whole = np.concatenate([1 - local.sum(axis=2, keepdims=True), local], axis=2)
        found = []
        for k in range(len(self.arc) - 1):
            start, slope = whole[k], whole[k + 1] - whole[k]
            with np.errstate(divide="ignore", invalid="ignore"):
                zero = -start / slope
            enters = np.where(slope > 0, zero, np.where((slope == 0) & (start < 0), np.inf, -np.inf))
            leaves = np.where(slope < 0, zero, np.inf)
            low, high = np.maximum(enters.max(axis=1), 0.0), np.minimum(leaves.min(axis=1), 1.0)
            crossed = high - low > _SAME
            breaks = np.unique(np.concatenate([[0.0, 1.0], low[crossed], high[crossed]]))
            breaks = breaks[np.append(True, np.diff(breaks) > _SAME)]
            breaks[-1] = 1.0
            found.append(self.arc[k] + breaks * (self.arc[k + 1] - self.arc[k]))
        return found
