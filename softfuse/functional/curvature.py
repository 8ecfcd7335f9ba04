"""How a material curve is stretched and bent at stations, as fibre Bragg gratings along it feel it.

The axial strain ε is the mean of |F t₀| − 1 along a gauge around the station, t₀ the tangent at rest. The
change of direction κ = dt/dS is that of the parabola nearest to the deformed curve x(S) along the gauge
(least squares, S the arc length at rest), because second derivatives in an element jump from one to the next.
Its components are told in the section's own frame, which the material carries: d₁ is the direction of F m₁
across t, d₂ = t × d₁. A core at distance d and angle θ from d₁ is strained by ε − d (κ₁ cos θ + κ₂ sin θ),
for sections that stay plane. Per length at rest, so that this is exact for large ε too.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.embedded_line import Polyline
from softfuse.functional.material_points import MaterialPoints

_SAMPLES = 9
"""Points along a gauge."""

_TRAPEZIA = np.array([0.5, *[1.0] * (_SAMPLES - 2), 0.5]) / (_SAMPLES - 1)
"""Their weights in a mean."""


class Curvature(MaterialFunctional):
    """s stations, each with points evenly along its `gauge` [m], station by station, with unit tangents
    (s, q, 3) at rest, and the direction m₁ of its section at rest, `across` (s, 3).
    """

    points: MaterialPoints
    tangent: Float[Array, "s q 3"]
    across: Float[Array, "s 3"]
    gauge: float = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        points: Float[np.ndarray, "p 3"],
        stations: Float[np.ndarray, " s"],
        gauge: float,
        across: Float[np.ndarray, "3"],
    ) -> "Curvature":
        """Stations (s,) m from the beginning of the curve through points (p, 3) m of a body at rest.

        `gauge` [m]: the length over which strain and curvature are averaged; `across` (3,): m₁, made
        perpendicular to the curve at each station. Raises MeshError for points outside the body, gauges
        that leave the curve, and directions along it.
        """
        curve, at = Polyline.through(points), np.asarray(stations, float).reshape(-1)
        over = np.maximum(0.5 * gauge - at, at + 0.5 * gauge - curve.length)
        if not gauge > 0 or np.any(over > 1e-9 * curve.length):
            worst = int(np.argmax(over))
            raise MeshError(
                f"station {worst} at {1e3 * at[worst]:g} mm of a line of {1e3 * curve.length:g} mm needs "
                f"half its gauge of {1e3 * gauge:g} mm on both sides: move it by "
                f"{1e3 * over[worst]:.3g} mm or more"
            )
        tangent = curve.tangent(at)
        m = np.asarray(across, float) / np.linalg.norm(across)
        m = m - np.einsum("si,i,sj->sj", tangent, m, tangent)
        length = np.linalg.norm(m, axis=1)
        if not np.all(length > 1e-3):
            raise MeshError(f"the direction across the line is along it at station {int(np.argmin(length))}")
        offsets = gauge * np.linspace(-0.5, 0.5, _SAMPLES)
        along = np.clip(at[:, None] + offsets, 0.0, curve.length)
        embedded = MaterialPoints.embedded(
            body, curve.at(along).reshape(-1, 3), named=f"gauge point ({_SAMPLES} a station)"
        )
        tangents = jnp.asarray(curve.tangent(along))
        return cls(embedded, tangents, jnp.asarray(m / length[:, None]), float(gauge))

    @property
    def count(self):
        """Three for each station."""
        return 3 * self.across.shape[0]

    def __call__(self, rest, displacement):
        """ε [-], κ₁ and κ₂ [1/m] of one station after the other (count,)."""
        s = self.across.shape[0]
        x = self.points.positions(rest, displacement).reshape(s, _SAMPLES, 3)
        each = self.points.deformation(rest, displacement).reshape(s, _SAMPLES, 3, 3)
        stretched = jnp.linalg.norm(jnp.einsum("sqij,sqj->sqi", each, self.tangent), axis=2)
        slope, bend = (jnp.einsum("q,sqi->si", row, x) for row in _derivatives(self.gauge))
        length = jnp.linalg.norm(slope, axis=1, keepdims=True)
        t = slope / length
        d1 = jnp.einsum("sqij,sj->si", each, self.across)
        d1 = d1 - jnp.sum(d1 * t, axis=1, keepdims=True) * t
        d1 = d1 / jnp.linalg.norm(d1, axis=1, keepdims=True)
        # What of x'' is across the curve is |x'| dt/dS.
        parts = [jnp.sum(bend / length * d, axis=1) for d in (d1, jnp.cross(t, d1))]
        return jnp.stack([stretched @ _TRAPEZIA - 1, *parts], axis=1).ravel()


def _derivatives(gauge: float) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """What the values along a gauge [m] weigh in the first and second derivative at its middle: [1/m] and
    [1/m²] (q,), those of the parabola nearest to them.
    """
    at = np.linspace(-0.5, 0.5, _SAMPLES)
    fit = np.linalg.pinv(np.vander(at, 3, increasing=True))
    return fit[1] / gauge, 2 * fit[2] / gauge**2
