"""Length of a material curve: ℓ = ∫ |F t| dS along its rest shape with unit tangent t, as a liquid-metal
channel, a strain fibre or a stretch resistor feels it; its conjugate is a tension along the curve [N].

The curve is cut where it passes from element to element, across which F jumps, and each piece has three Gauss
points: exact where |F t|² varies slowly in an element, as it does for strains that the mesh resolves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.material_points import MaterialPoints

_SAME = 1e-9  # of a piece: elements whose common part of it is shorter only touch it

_GAUSS = np.polynomial.legendre.leggauss(3)


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

    def crossings(self, body: AbstractBody) -> list[Float[np.ndarray, " _"]]:
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


class EmbeddedLine(MaterialFunctional):
    """Quadrature points of a curve with unit tangents t (g, 3) at rest and rest lengths `weight` (g,) [m],
    and the `segment` (g,) that each belongs to.
    """

    points: MaterialPoints
    tangent: Float[Array, "g 3"]
    weight: Float[Array, " g"]
    segment: Int[Array, " g"]
    segments: int = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        points: Float[np.ndarray, "p 3"],
        *,
        stations: Sequence[int] | None = None,
    ) -> "EmbeddedLine":
        """The curve through points (p, 3) m of a body at rest, straight between them.

        `stations`: numbers of the points between which lengths are told, in ascending order; without any, the
        whole length. Raises MeshError for points outside the body, and for stations that are none.
        """
        curve = Polyline.through(points)
        last = len(curve.points) - 1
        ends = [0, last] if stations is None else list(stations)
        if len(ends) < 2 or any(b <= a for a, b in zip(ends, ends[1:], strict=False)) or ends[0] < 0:
            raise MeshError(f"stations {ends} of a line must be two numbers or more, ascending from 0")
        if ends[-1] > last:
            raise MeshError(f"station {ends[-1]} of a line of {last + 1} points: the last is {last}")
        MaterialPoints.embedded(body, curve.points, named="point of the line")
        arc, weight, segment = [], [], []
        for piece, breaks in enumerate(curve.crossings(body)[: ends[-1]]):
            if piece < ends[0]:
                continue
            half = 0.5 * np.diff(breaks)
            arc.append((breaks[:-1] + half + half * _GAUSS[0][:, None]).ravel())
            weight.append((half * _GAUSS[1][:, None]).ravel())
            segment.append(np.full(arc[-1].size, np.searchsorted(ends, piece, side="right") - 1))
        at = np.concatenate(arc)
        return cls(
            MaterialPoints.embedded(body, curve.at(at), named="quadrature point of the line"),
            jnp.asarray(curve.tangent(at)),
            jnp.asarray(np.concatenate(weight)),
            jnp.asarray(np.concatenate(segment)),
            len(ends) - 1,
        )

    @property
    def count(self):
        """One for each segment."""
        return self.segments

    def __call__(self, rest, displacement):
        """Lengths (count,) [m] of the segments."""
        stretched = jnp.einsum("gij,gj->gi", self.points.deformation(rest, displacement), self.tangent)
        each = self.weight * jnp.linalg.norm(stretched, axis=1)
        return jnp.zeros(self.segments).at[self.segment].add(each)
