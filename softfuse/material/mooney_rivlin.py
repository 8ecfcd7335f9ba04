"""Compressible Mooney–Rivlin solid: W = c₁₀ (I₁ − 3 − 2 ln J) + c₀₁ (I₂/J² − 3 + 2 ln J) + λ/2 (ln J)².

I₂/J² = tr C⁻¹. At J = 1 this is Mooney's law c₁₀ (I₁ − 3) + c₀₁ (I₂ − 3). Dividing I₂ by J² makes the
small strains exactly those of μ = 2 (c₁₀ + c₀₁) and λ (with I₂ − 3 − 4 ln J instead, λ at rest would be
λ + 4 c₀₁) and makes the law equal to Ogden's of exponents 2 and −2.
Sources: Rivlin, Phil. Trans. R. Soc. A 241 (1948) 379; compressible form:
Ogden, Proc. R. Soc. A 328 (1972) 567.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.material.base import constant, lame_constants
from softfuse.material.isotropic import AbstractIsotropic, Invariants


class MooneyRivlin(AbstractIsotropic):
    """Mooney–Rivlin law of constants `c10` [Pa], `c01` [Pa] and Lamé's λ `lame` [Pa]."""

    c10: Float[Array, ""] = eqx.field(converter=constant)
    c01: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_young(cls, young: float, poisson: float, *, second_share: float = 0.0) -> "MooneyRivlin":
        """The law whose small strains have Young's modulus [Pa] and Poisson's ratio [-].

        `second_share` [-] is the part of the shear modulus that c₀₁ carries; 0 is neo-Hookean.
        """
        lame, mu = lame_constants(young, poisson)
        return cls(0.5 * mu * (1.0 - second_share), 0.5 * mu * second_share, lame)

    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """c₁₀ (I₁ − 3 − 2 ln J) + c₀₁ (I₂/J² − 3 + 2 ln J) (...) [J/m³]."""
        first = at.first - 3.0 - 2.0 * jnp.log(at.volume)
        second = at.second / at.volume**2 - 3.0 + 2.0 * jnp.log(at.volume)
        return self.c10 * first + self.c01 * second

    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """ln J (...) [-]."""
        return jnp.log(at.volume)

    def shear_modulus(self) -> Float[Array, ""]:
        """2 (c₁₀ + c₀₁) [Pa]."""
        return 2.0 * (self.c10 + self.c01)
