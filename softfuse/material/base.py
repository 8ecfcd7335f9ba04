"""What a hyperelastic law is: W(F) = distortion(F) + λ/2 · dilatation(F)², per unit rest volume.

F (3, 3) is the deformation gradient ∂x/∂X. The split serves nearly incompressible bodies: with an
independent pressure p the volumetric term becomes p · dilatation(F) − p²/(2λ) (perturbed Lagrangian), which
is exact for the same law, whatever λ. Sign: p > 0 is tension. Source: Bonet and Wood, Nonlinear Continuum
Mechanics for Finite Element Analysis, 2nd ed., ch. 6 and 8.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from softfuse.material.components import Tensor, whole


class AbstractMaterial(eqx.Module):
    """A strain-energy density; constants are array leaves, so that they can be fitted."""

    lame: eqx.AbstractVar[Float[Array, ""]]

    @abstractmethod
    def distortion(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """Energy density [J/m³] without the volumetric term, at the deformation gradient f (3, 3)."""

    @abstractmethod
    def dilatation(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """The law's own measure of volume change [-], zero at rest, at the deformation gradient f (3, 3)."""

    @abstractmethod
    def shear_modulus(self) -> Float[Array, ""]:
        """Shear modulus at rest [Pa]."""

    def times(self, factor: Float[ArrayLike, ""]) -> Self:
        """The same law, so many times as stiff against every strain: all constants in Pa times the factor."""
        return jax.tree.map(lambda constant: factor * constant, self)

    def stiffened(self, ratio: Float[ArrayLike, ""]) -> "AbstractMaterial":
        """Yeoh's law with a c₂ more by a ratio [-] times c₁, of one that is Yeoh's; itself of others."""
        del ratio
        return self

    def energy(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """Energy density [J/m³] at the deformation gradient f (3, 3)."""
        return self.distortion(f) + 0.5 * self.lame * self.dilatation(f) ** 2

    def measures(self, f: Tensor) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
        """Distortion [J/m³] and dilatation [-] at many deformation gradients."""
        whole_f = whole(f)
        flat = jnp.moveaxis(whole_f.reshape(3, 3, -1), -1, 0)
        shape = whole_f.shape[2:]
        return jax.vmap(self.distortion)(flat).reshape(shape), jax.vmap(self.dilatation)(flat).reshape(shape)


def lame_constants(young: float, poisson: float) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Lamé's λ and μ [Pa] of Young's modulus [Pa] and Poisson's ratio [-]."""
    lame = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    return constant(lame), constant(young / (2 * (1 + poisson)))


def constant(value: ArrayLike | Sequence[float]) -> Array:
    """A constant, of a material or of what presses on it, as a float array: a leaf that can be fitted."""
    return jnp.asarray(value, float)
