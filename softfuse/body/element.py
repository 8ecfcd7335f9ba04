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
from softfuse.material.base import AbstractMaterial

Density = Callable[[AbstractMaterial, Float[Array, "3 3"], Float[Array, ""]], Float[Array, ""]]


def displacement_density(
    material: AbstractMaterial, f: Float[Array, "3 3"], pressure: Float[Array, ""]
) -> Float[Array, ""]:
    """W(F) [J/m³]; a displacement element has no pressure."""
    del pressure
    return material.energy(f)


def mixed_density(
    material: AbstractMaterial, f: Float[Array, "3 3"], pressure: Float[Array, ""]
) -> Float[Array, ""]:
    """W_d(F) + p θ(F) − p²/(2λ) [J/m³] at the pressure p [Pa], tension positive."""
    return material.distortion(f) + pressure * material.dilatation(f) - pressure**2 / (2 * material.lame)


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


def shape_gradients(
    element: Element, corners_and_middles: Float[Array, "e a 3"]
) -> tuple[Float[Array, "e q a 3"], Float[Array, "e q"]]:
    """∂N_a/∂X [1/m] and volume weights [m³] at the quadrature points of elements with rest nodes (e, a, 3) m.

    Isoparametric: quadratic elements may have curved edges.
    """
    local = jnp.asarray(element.slopes[:, :, 1:] - element.slopes[:, :, :1])
    jacobian = jnp.einsum("eai,qak->eqik", corners_and_middles, local)
    gradients = jnp.einsum("qak,eqki->eqai", local, jnp.linalg.inv(jacobian))
    return gradients, jnp.linalg.det(jacobian) * element.weights / 6.0
