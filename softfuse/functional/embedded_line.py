"""Length of a material curve: ℓ = ∫ |F t| dS along its rest shape with unit tangent t, as a liquid-metal
channel, a strain fibre or a stretch resistor feels it; its conjugate is a tension along the curve [N].

The curve is cut where it passes from element to element, across which F jumps, and each piece has three Gauss
points: exact where |F t|² varies slowly in an element, as it does for strains that the mesh resolves.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.material_points import MaterialPoints
from softfuse.functional.polyline import Polyline

_GAUSS = np.polynomial.legendre.leggauss(3)


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
