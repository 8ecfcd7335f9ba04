"""Isotropic laws: W depends on F through I₁ = tr C, I₂ = ‖cof F‖² = tr cof C and J = det F alone, C = FᵀF.

The first Piola stress is then P = ∂W/∂F = 2 W₁ F + 2 W₂ cof F ⨯ F + W_J cof F, with slopes of a function of
three numbers (⨯: `components.cross`; cof F ⨯ F = I₁ F − F C, without its cancellation under large stretches).
The derivative of `invariants` is written such that differentiating an energy gives just these products, and
only those of invariants that the law uses.
Source: Bonet, Gil and Wood, Comput. Methods Appl. Mech. Eng. 283 (2015) 1061.
"""

from abc import abstractmethod
from typing import NamedTuple

import jax
from jaxtyping import Array, Float

from softfuse.material.base import AbstractMaterial
from softfuse.material.components import Tensor, cofactor, components, contraction, cross, determinant


class Invariants(NamedTuple):
    """I₁ = tr C, I₂ = tr cof C and J = det F [-] at one point or at many (...)."""

    first: Float[Array, "..."]
    second: Float[Array, "..."]
    volume: Float[Array, "..."]


@jax.custom_jvp
def invariants(f: Tensor) -> Invariants:
    """The invariants (...) of deformation gradients."""
    c = cofactor(f)
    return Invariants(contraction(f, f), contraction(c, c), determinant(f))


@invariants.defjvp
def _invariants_jvp(primals: tuple[Tensor], tangents: tuple[Tensor]) -> tuple[Invariants, Invariants]:
    """dI₁ = 2 F : dF, dI₂ = 2 (cof F ⨯ F) : dF, dJ = cof F : dF."""
    (f,), (df,) = primals, tangents
    c = cofactor(f)
    slopes = 2.0 * contraction(f, df), 2.0 * contraction(cross(c, f), df), contraction(c, df)
    return invariants(f), Invariants(*slopes)


class AbstractIsotropic(AbstractMaterial):
    """A law of the invariants, written once for a point or for arrays of points."""

    @abstractmethod
    def distortion_of(self, at: Invariants) -> Float[Array, "..."]:
        """Energy density (...) [J/m³] without the volumetric term."""

    @abstractmethod
    def dilatation_of(self, at: Invariants) -> Float[Array, "..."]:
        """The law's own measure of volume change (...) [-], zero at rest."""

    def distortion(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """Energy density [J/m³] without the volumetric term, at the deformation gradient f (3, 3)."""
        return self.distortion_of(invariants(components(f)))

    def dilatation(self, f: Float[Array, "3 3"]) -> Float[Array, ""]:
        """The law's own measure of volume change [-] at the deformation gradient f (3, 3)."""
        return self.dilatation_of(invariants(components(f)))

    def measures(self, f: Tensor) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
        """Distortion [J/m³] and dilatation [-] at many deformation gradients."""
        at = invariants(f)
        return self.distortion_of(at), self.dilatation_of(at)
