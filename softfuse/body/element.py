"""Three finite elements on tetrahedra: linear, quadratic, and Taylor-Hood (quadratic displacement,
continuous linear pressure).

An element's generalised strain at a quadrature point is h = (F, p): the deformation gradient F = I + Σ u_a ⊗
∇N_a and, for
Taylor-Hood, the pressure p = Σ p_a L_a. Its density is W(F) or, for Taylor-Hood, the perturbed Lagrangian
W_d(F) + p θ(F) − p²/(2λ),
whose saddle point is the solution. Linear and quadratic displacement elements lock or drift for ν near 0.5;
Taylor-Hood does not.
Source: Boffi, Brezzi and Fortin, Mixed Finite Element Methods and Applications, 2013, ch. 8.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.quadrature import TET_1, TET_4
from softfuse.body.shape import linear, linear_slopes, quadratic, quadratic_slopes
from softfuse.material.components import cofactor, components, determinant, whole

Density = Callable[[Array, Array, Array, Array], Array]


def displacement_density(
    distortion: Float[Array, "..."],
    dilatation: Float[Array, "..."],
    lame: Float[Array, ""],
    pressure: Float[Array, "..."],
) -> Float[Array, "..."]:
    """W(F) [J/m³] of a law's measures; a displacement element has no pressure."""
    del pressure
    return distortion + 0.5 * lame * dilatation**2


def mixed_density(
    distortion: Float[Array, "..."],
    dilatation: Float[Array, "..."],
    lame: Float[Array, ""],
    pressure: Float[Array, "..."],
) -> Float[Array, "..."]:
    """W_d(F) + p θ(F) − p²/(2λ) [J/m³] of a law's measures at the pressure p [Pa], tension positive."""
    return distortion + pressure * dilatation - pressure**2 / (2 * lame)


@dataclass(frozen=True)
class Element:
    """One finite element: `nodes` displacement nodes, `pressures` pressure nodes (the corners), and its
    quadrature.
    """

    name: str
    order: int
    nodes: int
    pressures: int
    density: Density
    points: np.ndarray = field(repr=False, hash=False, compare=False)
    weights: np.ndarray = field(repr=False, hash=False, compare=False)
    slopes: np.ndarray = field(repr=False, hash=False, compare=False)
    values: np.ndarray = field(repr=False, hash=False, compare=False)

    @property
    def local_nodes(self) -> np.ndarray:
        """The local node (d,) that each of the element's unknowns sits on: displacements node by node, then
        pressures.
        """
        return np.concatenate([np.repeat(np.arange(self.nodes), 3), np.arange(self.pressures)])


LINEAR = Element(
    "linear", 1, 4, 0, displacement_density, *TET_1, linear_slopes(TET_1[0]), np.asarray(linear(TET_1[0]))
)
QUADRATIC = Element(
    "quadratic",
    2,
    10,
    0,
    displacement_density,
    *TET_4,
    quadratic_slopes(TET_4[0]),
    np.asarray(quadratic(TET_4[0])),
)
TAYLOR_HOOD = Element(
    "taylor-hood",
    2,
    10,
    4,
    mixed_density,
    *TET_4,
    quadratic_slopes(TET_4[0]),
    np.asarray(quadratic(TET_4[0])),
)
ELEMENTS = {element.name: element for element in (LINEAR, QUADRATIC, TAYLOR_HOOD)}


def frames(
    element: Element, nodes: Float[Array, "e a 3"]
) -> tuple[Float[Array, "3 3 q e"], Float[Array, "q e"]]:
    """w ∂ξ_m/∂X_j [m²] and volumes w [m³] of the quadrature points of elements with rest nodes (e, a, 3) m.

    Isoparametric: quadratic elements may have curved edges. ξ are the last three barycentric coordinates.
    """
    local = jnp.asarray(element.slopes[:, :, 1:] - element.slopes[:, :, :1])
    part = jnp.asarray(element.weights[:, None] / 6.0)
    jacobian = components(jnp.einsum("eai,qam->imqe", nodes, local))
    # ∂ξ/∂X det = (cof ∂X/∂ξ)ᵀ
    return part * whole(cofactor(jacobian)).swapaxes(0, 1), part * determinant(jacobian)
