"""Potentials of evenly charged squares, the elements of a method of moments.

A square of side a in a plane, with the charge 1 C spread evenly over it, has at the place (x, y, z) from its
middle the potential

    φ = 1/(4πε a²) Σ± ± [u ln(v + r) + v ln(u + r) − z atan(u v/(z r))],  r² = u² + v² + z²,

summed over its corners (u, v) = (x ± a/2, y ± a/2) with the sign of their product. Source: Hess and Smith,
Prog. Aeronaut. Sci. 8 (1967) 1, for constant sources; Harrington, Field Computation by Moment Methods, 1968,
ch. 2. Far away it is that of a point, 1/(4πε r).
"""

import numpy as np
from jaxtyping import Float

_IN_PLANE_M = 1e-9
"""Height above the plane of a square that is none: the terms in z need one."""


def square_potential(
    offset: Float[np.ndarray, "*n 3"], side: Float[np.ndarray, "*n"], permittivity: float
) -> Float[np.ndarray, "*n"]:
    """Potential (*n) [V/C] at offsets (*n, 3) m from the middles of squares of sides (*n) m.

    Squares lie across z, their sides along x and y; permittivity in F/m.
    """
    x, y = offset[..., 0], offset[..., 1]
    z = np.maximum(np.abs(offset[..., 2]), _IN_PLANE_M)
    total = np.zeros(np.broadcast_shapes(x.shape, side.shape))
    for sign_u in (-1.0, 1.0):
        for sign_v in (-1.0, 1.0):
            u, v = x + 0.5 * sign_u * side, y + 0.5 * sign_v * side
            r = np.sqrt(u * u + v * v + z * z)
            corner = u * np.log(v + r) + v * np.log(u + r) - z * np.arctan(u * v / (z * r))
            total += sign_u * sign_v * corner
    return total / (4.0 * np.pi * permittivity * side**2)


def point_potential(offset: Float[np.ndarray, "*n 3"], permittivity: float) -> Float[np.ndarray, "*n"]:
    """Potential (*n) [V/C] at offsets (*n, 3) m from points; infinite at the point itself."""
    with np.errstate(divide="ignore"):
        return 1.0 / (4.0 * np.pi * permittivity * np.linalg.norm(offset, axis=-1))


def own_potential(side: Float[np.ndarray, "*n"], permittivity: float) -> Float[np.ndarray, "*n"]:
    """Potential (*n) [V/C] in the middle of squares of sides (*n) m: ln(1 + √2)/(π ε a)."""
    return np.log(1.0 + np.sqrt(2.0)) / (np.pi * permittivity * side)
