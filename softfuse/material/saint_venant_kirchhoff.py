"""Saint-Venant–Kirchhoff solid: W = μ tr(E²) + λ/2 (tr E)², with Green's strain E = (FᵀF − I)/2.

For large rotations and small strains: under compression it softens and finally lets an element invert at a
finite energy. Source: Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed.,
ch. 6 (exercise on the Saint-Venant–Kirchhoff material).
"""

import equinox as eqx
from jaxtyping import Array, Float

from softfuse.material.base import constant, lame_constants
from softfuse.material.isotropic import AbstractIsotropic, Invariants


class SaintVenantKirchhoff(AbstractIsotropic):
    """Saint-Venant–Kirchhoff law of shear modulus `mu` [Pa] and Lamé's λ `lame` [Pa]."""

    mu: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_young(cls, young: float, poisson: float) -> "SaintVenantKirchhoff":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-]."""
        lame, mu = lame_constants(young, poisson)
        return cls(mu, lame)

    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """μ tr(E²) (...) [J/m³]: 4 tr(E²) = I₁² − 2 I₂ − 2 I₁ + 3."""
        x, y = at.first - 3.0, at.second - 3.0
        return 0.25 * self.mu * (x**2 + 4.0 * x - 2.0 * y)

    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """tr E (...) [-]."""
        return 0.5 * (at.first - 3.0)

    def shear_modulus(self) -> Float[Array, ""]:
        """μ [Pa]."""
        return self.mu
