"""Hydrostatic pressure of the material at a place, as a barometer cast into it reads it: −tr σ/3 [Pa], mean
over a small ball; compression is positive.

Cauchy's stress σ = (∂ψ/∂F) Fᵀ/J is that of the element's own density ψ(F, p), with the interpolated pressure
unknown p of mixed elements. The cavity or chip of a real sensor concentrates the stress around itself: a
factor that is the sensor's gain, to be calibrated.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.body import Body
from softfuse.functional.base import AbstractFunctional
from softfuse.functional.material_points import MaterialPoints
from softfuse.functional.orientation import patch
from softfuse.material.components import components, determinant


class PointPressure(AbstractFunctional):
    """A ball's points; `corners` (g, c): their elements' pressure nodes; `regions`: materials, ascending."""

    points: MaterialPoints
    corners: Int[Array, "g c"]
    regions: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, body: Body, centre: Float[np.ndarray, "3"], radius: float) -> "PointPressure":
        """A ball of `radius` [m] around `centre` (3,) m in a full body at rest; a reduced one of it serves
        too. Raises MeshError where the ball reaches out of the body.
        """
        points = patch(body, centre, radius)
        # Those of one material together, in the order of the body's elements.
        order = np.argsort(np.asarray(points.element), kind="stable")
        points = jax.tree.map(lambda leaf: leaf[order], points)
        element = np.asarray(points.element)
        corners = np.asarray(body.pressure_unknowns).T[element] - body.n_displacements
        regions = np.searchsorted(np.cumsum(body.counts), element, side="right")
        return cls(points, jnp.asarray(corners), tuple(regions.tolist()))

    def value(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, ""]:
        """The pressure [Pa] at unknowns z (n,) of a body that watches the functional's nodes."""
        f = jnp.moveaxis(self.points.deformation(body.rest, body.watched(z)), 0, -1)
        pressure = self._mixed(body, z)
        factors = jnp.ones(len(self.regions))
        if body.factors is not None:
            factors = body.factors[self.points.element]
        found = []
        for region in sorted(set(self.regions)):
            own = np.flatnonzero(np.array(self.regions) == region)
            found.append(_hydrostatic(body, region, f[..., own], pressure[own], factors[own]))
        return jnp.mean(jnp.concatenate(found))

    def change(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, ""]:
        """The pressure [Pa] beyond that at rest, which is none."""
        return self.value(body, z)

    def _mixed(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, " g"]:
        """p [Pa] at the points, 0 for elements without."""
        if not self.corners.shape[1]:
            return jnp.zeros(len(self.regions))
        local = self.points.local
        whole = jnp.concatenate([1 - jnp.sum(local, axis=1, keepdims=True), local], axis=1)
        return jnp.sum(whole * body.pressures(z, self.corners), axis=1)


def _hydrostatic(
    body: AbstractBody,
    region: int,
    f: Float[Array, "3 3 g"],
    pressure: Float[Array, " g"],
    factors: Float[Array, " g"],
) -> Float[Array, " g"]:
    """−tr σ/3 (g,) [Pa] at points of one material."""
    law = body.law(region)

    def energy(f: Float[Array, "3 3 g"]) -> Float[Array, ""]:
        measures = law.measures(components(f))
        return jnp.sum(factors * body.element.density(*measures, law.lame, pressure / factors))

    stress = jax.grad(energy)(f)
    return -jnp.einsum("ijg,ijg->g", stress, f) / (3 * determinant(components(f)))
