"""Response of crossed lines of diamond electrodes to a grounded cylinder.

Rows and columns are chains of diamonds that tile the plane: the diamonds of a column sit midway between the
rows' centre lines and the other way round, with half a diamond at both ends of every line. The response of a
line is the integral of the cylinder's charge density (wall_field) over the line's diamonds,

    s_k = (2 / (pi R0^2)) * integral over diamonds of line k of kappa(|r - r_contact|) dA,

dimensionless: a cylinder of the reference radius R0 = one pitch, wholly over diamonds of which half belong to
the lines of this direction, gives a sum of about (R / R0)^2. It is a Gauss quadrature, smooth in everything.

The outermost lines also collect flux that passes the array's rim and would otherwise land beyond it. It is
modelled as a strip of width `rim` along the rim, half of which belongs to the outermost line.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.sensing.wall_field import disc_density

_GAUSS_POINTS = 4  # per side of a diamond: cells of 1.4 mm at 8 mm pitch, the fringe is 1 to 2 mm wide
_TINY_M = 1e-7  # keeps the distance from the axis differentiable at zero


def diamond_quadrature(
    own_m: Float[Array, " n"], cross_m: Float[Array, " m"]
) -> tuple[Float[Array, "n q"], Float[Array, "n q"], Float[Array, "n q"]]:
    """Gauss points of the diamonds of parallel lines.

    Args: own_m (n,) centre lines' coordinate across the lines [m], ascending; cross_m (m,) coordinate of the
    crossing lines [m], ascending. Both at least two.
    Returns: points' coordinate across the lines (n, q) [m], along them (n, q) [m], and areas (n, q) [m^2].
    """
    gauss, weight = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    a, b = (grid.ravel() for grid in np.meshgrid(gauss, gauss, indexing="ij"))
    w = np.outer(weight, weight).ravel()
    half_own = 0.5 * (own_m[-1] - own_m[0]) / (own_m.shape[0] - 1)
    centre = 0.5 * (cross_m[1:] + cross_m[:-1])
    half_cross = 0.5 * (cross_m[1:] - cross_m[:-1])
    across = [jnp.tile(half_own * 0.5 * (a + b), centre.shape[0])]
    along = [(centre[:, None] + half_cross[:, None] * (0.5 * (a - b))).ravel()]
    area = [(0.5 * half_own * half_cross[:, None] * w).ravel()]
    # A half diamond at each end: its apex on the crossing line, its base on the array's rim.
    height = 0.5 * (1.0 + a)
    for apex, reach in ((cross_m[0], -half_cross[0]), (cross_m[-1], half_cross[-1])):
        across.append(half_own * height * b)
        along.append(apex + reach * height)
        area.append(0.5 * half_own * jnp.abs(reach) * height * w)
    relative = jnp.concatenate(across)
    shape = (own_m.shape[0], relative.shape[0])
    return (
        own_m[:, None] + relative,
        jnp.broadcast_to(jnp.concatenate(along), shape),
        jnp.broadcast_to(jnp.concatenate(area), shape),
    )


def rim_quadrature(
    own_m: Float[Array, " n"], cross_m: Float[Array, " m"], rim_m: Float[Array, ""]
) -> tuple[Float[Array, "2 q"], Float[Array, "2 q"], Float[Array, "2 q"]]:
    """Points of the two strips along the rim whose flux the first and the last line collect.

    Args: own_m (n,), cross_m (m,) as for diamond_quadrature [m]; rim_m width of the strip [m].
    Returns: coordinate across the lines (2, q) [m], along them (2, q) [m], areas (2, q) [m^2] (half the
    strip's).
    """
    gauss, weight = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    half_own = 0.5 * (own_m[-1] - own_m[0]) / (own_m.shape[0] - 1)
    half_cross = 0.5 * (cross_m[-1] - cross_m[0]) / (cross_m.shape[0] - 1)
    along = (cross_m[:, None] + half_cross * gauss).ravel()
    area = 0.5 * rim_m * jnp.tile(half_cross * weight, cross_m.shape[0])
    outside = half_own + 0.5 * rim_m
    across = jnp.stack([own_m[0] - outside, own_m[-1] + outside])
    shape = (2, along.shape[0])
    return (
        jnp.broadcast_to(across[:, None], shape),
        jnp.broadcast_to(along, shape),
        jnp.broadcast_to(area, shape),
    )


def line_response(
    own_m: Float[Array, " n"],
    cross_m: Float[Array, " m"],
    rim_m: Float[Array, ""],
    contact_own_m: Float[Array, ""],
    contact_cross_m: Float[Array, ""],
    radius_m: Float[Array, ""],
    depth_m: Float[Array, ""],
) -> Float[Array, " n"]:
    """Response of parallel electrode lines to a grounded cylinder standing on the pad.

    Args: own_m (n,) coordinates of the lines [m]; cross_m (m,) of the lines that cross them [m]; rim_m width
    of the strip whose flux the outermost lines collect [m]; contact_own_m, contact_cross_m coordinates of the
    cylinder's axis across and along the lines [m]; radius_m [m]; depth_m of the lines below its bottom [m].
    Returns: response (n,), dimensionless.
    """
    pitch = (own_m[-1] - own_m[0]) / (own_m.shape[0] - 1)

    def charge(across, along, area):
        rho = jnp.sqrt((across - contact_own_m) ** 2 + (along - contact_cross_m) ** 2 + _TINY_M**2)
        return jnp.sum(area * disc_density(rho, radius_m, depth_m), axis=1)

    total = charge(*diamond_quadrature(own_m, cross_m))
    rim = charge(*rim_quadrature(own_m, cross_m, rim_m))
    total = total.at[0].add(rim[0]).at[-1].add(rim[1])
    return total * (2.0 / (jnp.pi * pitch**2))
