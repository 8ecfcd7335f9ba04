"""Compressible neo-Hookean solid: W = μ/2 (I₁ − 3 − 2 ln J) + λ/2 (ln J)².

Source: Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., eq. 6.27.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.material.base import AbstractMaterial, first_invariant, jacobian, lame_constants


class NeoHookean(AbstractMaterial):
    """Neo-Hookean law of shear modulus `mu` [Pa] and Lamé's λ `lame` [Pa]."""

    mu: Float[Array, ""]
    lame: Float[Array, ""]

    @classmethod
    def from_young(cls, young: float, poisson: float) -> "NeoHookean":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-]."""
        lame, mu = lame_constants(young, poisson)
        return cls(mu, lame)

    def distortion(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """μ/2 (I₁ − 3 − 2 ln J) [J/m³]."""
        return 0.5 * self.mu * (first_invariant(f) - 3.0 - 2.0 * jnp.log(jacobian(f)))

    def dilatation(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """ln J [-]."""
        return jnp.log(jacobian(f))

    def shear_modulus(self) -> Float[Array, ""]:
        """μ [Pa]."""
        return self.mu
