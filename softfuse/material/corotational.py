"""Corotational linear solid: W = μ ‖F − R‖² + λ/2 (tr S − 3)², with the polar decomposition F = R S.

‖F − R‖² = tr C − 2 tr S + 3 needs only the trace of S = √(FᵀF), so neither R nor an eigenvector is ever
differentiated. This is the energy whose elements rotate by the polar factor of F. An inverted element
(J < 0) keeps a finite energy, that of the nearest rotation: it can recover, but it must be reported. Source:
Sifakis and Barbič, FEM Simulation of 3D Deformable Solids (SIGGRAPH 2012 course), sec. 3.4.
"""

import equinox as eqx
from jaxtyping import Array, Float

from softfuse.material.base import constant, lame_constants
from softfuse.material.isotropic import AbstractIsotropic, Invariants
from softfuse.material.square_root import trace_of_root


class Corotational(AbstractIsotropic):
    """Corotational linear law of shear modulus `mu` [Pa] and Lamé's λ `lame` [Pa]."""

    mu: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_young(cls, young: float, poisson: float) -> "Corotational":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-]."""
        lame, mu = lame_constants(young, poisson)
        return cls(mu, lame)

    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """μ ‖F − R‖² (...) [J/m³]."""
        return self.mu * (at.first - 3.0 - 2.0 * self.dilatation_of(at))

    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """tr S − 3 (...) [-]."""
        return trace_of_root(at.first - 3.0, at.second - 3.0, at.volume - 1.0)

    def shear_modulus(self) -> Float[Array, ""]:
        """μ [Pa]."""
        return self.mu
