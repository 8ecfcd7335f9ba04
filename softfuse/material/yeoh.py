"""Compressible Yeoh solid: W = c₁ x + c₂ x² + c₃ x³ + λ/2 (ln J)², with x = I₁ − 3 − 2 ln J ≥ 0.

At J = 1, x = I₁ − 3 and this is Yeoh's law. −2 ln J removes the stress of I₁ at rest; since x is of second
order in the strain, c₂ and c₃ change neither the stress nor the stiffness at rest: μ = 2 c₁ and Lamé's λ is
exactly λ. With c₃ < 0 the stress falls again beyond the stretch where c₁ + 2 c₂ x + 3 c₃ x² = 0: such
constants are valid below it only.
Source: Yeoh, Rubber Chem. Technol. 66 (1993) 754.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.material.base import constant, lame_constants
from softfuse.material.isotropic import AbstractIsotropic, Invariants


class Yeoh(AbstractIsotropic):
    """Yeoh law of constants `c1`, `c2`, `c3` [Pa] and Lamé's λ `lame` [Pa]."""

    c1: Float[Array, ""] = eqx.field(converter=constant)
    c2: Float[Array, ""] = eqx.field(converter=constant)
    c3: Float[Array, ""] = eqx.field(converter=constant)
    lame: Float[Array, ""] = eqx.field(converter=constant)

    @classmethod
    def from_poisson(cls, c1: float, c2: float, c3: float, poisson: float) -> "Yeoh":
        """The law of constants c1, c2, c3 [Pa] whose small strains have the Poisson's ratio [-]."""
        lame, _ = lame_constants(4.0 * c1 * (1.0 + poisson), poisson)
        return cls(c1, c2, c3, lame)

    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """c₁ x + c₂ x² + c₃ x³ (...) [J/m³]."""
        x = at.first - 3.0 - 2.0 * jnp.log(at.volume)
        return x * (self.c1 + x * (self.c2 + x * self.c3))

    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """ln J (...) [-]."""
        return jnp.log(at.volume)

    def shear_modulus(self) -> Float[Array, ""]:
        """2 c₁ [Pa]."""
        return 2.0 * self.c1

    def stiffened(self, ratio):
        """With that c₂."""
        return Yeoh(self.c1, self.c2 + ratio * self.c1, self.c3, self.lame)
