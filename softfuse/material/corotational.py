"""Corotational linear solid: W = μ ‖F − R‖² + λ/2 (tr S − 3)², with the polar decomposition F = R S.

‖F − R‖² = tr C − 2 tr S + 3 needs only the trace of S = √(FᵀF), so neither R nor an eigenvector is ever
differentiated. This is the energy whose elements rotate by the polar factor of F. An inverted element
(J < 0) keeps a finite energy, that of the nearest rotation: it can recover, but it must be reported. Source:
Sifakis and Barbič, FEM Simulation of 3D Deformable Solids (SIGGRAPH 2012 course), sec. 3.4.
"""

import equinox as eqx
from jaxtyping import Array, Float

from softfuse.material.base import (
    AbstractMaterial,
    constant,
    first_invariant,
    jacobian,
    lame_constants,
    second_invariant,
)
from softfuse.material.square_root import trace_of_root

ROOT_STEPS = 8  # enough for inverted elements too


class Corotational(AbstractMaterial):
    """Corotational linear law of shear modulus `mu` [Pa] and Lamé's λ `lame` [Pa]."""

    mu: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_young(cls, young: float, poisson: float) -> "Corotational":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-]."""
        lame, mu = lame_constants(young, poisson)
        return cls(mu, lame)

    def distortion(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """μ ‖F − R‖² [J/m³] at the deformation gradient f (3, 3)."""
        return self.mu * (first_invariant(f) - 3.0 - 2.0 * self.dilatation(f))

    def dilatation(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """tr S − 3 [-] at the deformation gradient f (3, 3)."""
        x, y = first_invariant(f) - 3.0, second_invariant(f) - 3.0
        return trace_of_root(x, y, jacobian(f) - 1.0, ROOT_STEPS)

    def shear_modulus(self) -> Float[Array, ""]:
        """μ [Pa]."""
        return self.mu
