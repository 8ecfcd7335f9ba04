"""Area and thickness of a thin flat sheet in the material, such as a dielectric between soft electrodes.

With the unit normal N at rest, an area dA becomes |cof F N| dA (Nanson), and the distance of two material
planes across N becomes s = 1/|F⁻ᵀ N| times as large. The capacitance is C = ε ∫ da/(d s); with the area a and
the mean stretch s̄ = a / ∫ da/s it is ε a/(d s̄) exactly. Source: Holzapfel, Nonlinear Solid Mechanics, 2000,
Sec. 2.4.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import MeshError
from softfuse.functional.base import MaterialFunctional
from softfuse.functional.material_points import MaterialPoints
from softfuse.material.components import cofactor, components, determinant, whole

_GAUSS = np.polynomial.legendre.leggauss(2)


class EmbeddedSheet(MaterialFunctional):
    """Quadrature points of a sheet with unit `normal` N (3,) and rest areas `weight` (g,) [m²]."""

    points: MaterialPoints
    normal: Float[Array, "3"]
    weight: Float[Array, " g"]

    @classmethod
    def of(
        cls,
        body: AbstractBody,
        centre: Float[np.ndarray, "3"],
        edges: Float[np.ndarray, "2 3"],
        *,
        spacing: float | None = None,
    ) -> "EmbeddedSheet":
        """The parallelogram around `centre` (3,) m with two whole `edges` (2, 3) m, in a body at rest.

        It is cut into cells no longer than `spacing` [m], a typical element where not given, with 2 x 2 Gauss
        points each. Raises MeshError for a sheet that leaves the body, or without area.
        """
        centre, edges = np.asarray(centre, float), np.asarray(edges, float)
        across = np.cross(*edges)
        area, lengths = float(np.linalg.norm(across)), np.linalg.norm(edges, axis=1)
        if not area > 1e-9 * lengths.max() ** 2:
            raise MeshError("the edges of a sheet are along the same line: give two directions in its plane")
        size = np.cbrt(6 * float(body.volume) / len(body.tets)) if spacing is None else spacing
        cells = np.maximum(1, np.ceil(lengths / size - 1e-9)).astype(int)
        first, second = (((np.arange(n)[:, None] + 0.5 + 0.5 * _GAUSS[0]) / n).ravel() - 0.5 for n in cells)
        corners = centre + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2) @ edges
        MaterialPoints.embedded(body, corners, named="corner of the sheet")
        grid = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
        points = MaterialPoints.embedded(body, centre + grid @ edges, named="quadrature point of the sheet")
        weight = np.full(len(grid), area / len(grid))
        return cls(points, jnp.asarray(across / area), jnp.asarray(weight))

    @property
    def count(self):
        """Area and thickness."""
        return 2

    def __call__(self, rest, displacement):
        """Area a [m²], and mean stretch s̄ [-] across the sheet (2,)."""
        f = components(jnp.moveaxis(self.points.deformation(rest, displacement), 0, -1))
        across = jnp.einsum("ijg,j->gi", whole(cofactor(f)), self.normal)
        grown = jnp.linalg.norm(across, axis=1)
        area = jnp.sum(self.weight * grown)
        # 1/s = |F⁻ᵀ N| = |cof F N| / J.
        return jnp.stack([area, area / jnp.sum(self.weight * grown**2 / determinant(f))])
