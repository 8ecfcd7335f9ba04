"""Saint-Venant–Kirchhoff solid: W = μ tr(E²) + λ/2 (tr E)², with Green's strain E = (FᵀF − I)/2.

For large rotations and small strains: under compression it softens and finally lets an element invert at a
finite energy. Source: Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed.,
ch. 6 (exercise on the Saint-Venant–Kirchhoff material).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.material.base import AbstractMaterial, constant, lame_constants


class SaintVenantKirchhoff(AbstractMaterial):
    """Saint-Venant–Kirchhoff law of shear modulus `mu` [Pa] and Lamé's λ `lame` [Pa]."""

    mu: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_young(cls, young: float, poisson: float) -> "SaintVenantKirchhoff":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-]."""
        lame, mu = lame_constants(young, poisson)
        return cls(mu, lame)

    def distortion(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """μ tr(E²) [J/m³] at the deformation gradient f (3, 3)."""
        return self.mu * jnp.sum(_green_strain(f) ** 2)

    def dilatation(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """tr E [-] at the deformation gradient f (3, 3)."""
        return jnp.trace(_green_strain(f))

    def shear_modulus(self) -> Float[Array, ""]:
        """μ [Pa]."""
        return self.mu


def _green_strain(f: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """E = (FᵀF − I)/2 [-]."""
    return 0.5 * (f.T @ f - jnp.eye(3))
