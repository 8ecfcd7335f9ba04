"""Compressible neo-Hookean solid: W = μ/2 (I₁ − 3 − 2 ln J) + λ/2 (ln J)².

Source: Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., eq. 6.27.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.material.base import constant, lame_constants
from softfuse.material.isotropic import AbstractIsotropic, Invariants
from softfuse.material.yeoh import Yeoh


class NeoHookean(AbstractIsotropic):
    """Neo-Hookean law of shear modulus `mu` [Pa] and Lamé's λ `lame` [Pa]."""

    mu: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_young(cls, young: float, poisson: float) -> "NeoHookean":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-]."""
        lame, mu = lame_constants(young, poisson)
        return cls(mu, lame)

    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """μ/2 (I₁ − 3 − 2 ln J) (...) [J/m³]."""
        return 0.5 * self.mu * (at.first - 3.0 - 2.0 * jnp.log(at.volume))

    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """ln J (...) [-]."""
        return jnp.log(at.volume)

    def shear_modulus(self) -> Float[Array, ""]:
        """μ [Pa]."""
        return self.mu

    def stiffened(self, ratio):
        """Neo-Hookean is Yeoh's with c₁ = μ/2 alone."""
        return Yeoh(0.5 * self.mu, 0.5 * self.mu * ratio, 0.0, self.lame)
