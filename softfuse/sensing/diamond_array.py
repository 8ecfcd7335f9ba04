"""Response of crossed lines of diamond electrodes to a grounded cylinder.

Rows and columns are chains of diamonds that tile the plane: the diamonds of a column sit midway between the
rows' centre lines and the other way round, with half a diamond at both ends of every line. The response of a
line is the integral of the cylinder's charge density (wall_field) over the line's diamonds,

    f_k = (2 / (pi p^2)) * integral over the diamonds of line k of kappa(|r - r_contact|) dA,

dimensionless, p being the pitch: a cylinder of radius p, wholly over the array, gives about 1 in total over
the lines of a layer, since half of the area belongs to either layer. It is a Gauss quadrature, smooth in
everything.

The outermost lines also collect flux that passes the array's rim and would otherwise land beyond it. It is
modelled as a strip of width `rim` along the rim, half of which belongs to the outermost line.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.sensing.wall_field import disc_density

_GAUSS_POINTS = 4  # per side of a diamond: cells of 1.4 mm at 8 mm pitch, the fringe is 1 to 2 mm wide
_TINY_M = 1e-7  # keeps the distance from the axis differentiable at zero


class LinePoints(eqx.Module):
    """Quadrature points of n parallel lines (q each) and of the two strips along their rim (s each)."""

    across_m: Float[Array, " n*q+2*s"]
    """Coordinate across the lines [m], line by line, then the first line's strip, then the last one's."""
    along_m: Float[Array, " n*q+2*s"]
    """Coordinate along the lines [m]."""
    area_m2: Float[Array, " n*q+2*s"]
    """Area [m^2]."""
    lines: int = eqx.field(static=True)
    """n."""
    rim_points: int = eqx.field(static=True)
    """s."""


def line_points(
    own_m: Float[Array, " n"], cross_m: Float[Array, " m"], rim_m: Float[Array, ""]
) -> LinePoints:
    """Gauss points of the diamonds of parallel lines and of the strips along their rim.

    Args: own_m (n,) centre lines' coordinate across the lines [m]; cross_m (m,) coordinate of the lines
    that cross them [m]; both ascending, at least two; rim_m width of the strips [m].
    """
    gauss, weight = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    a, b = (grid.ravel() for grid in np.meshgrid(gauss, gauss, indexing="ij"))
    w = np.outer(weight, weight).ravel()
    half_own = 0.5 * mean_pitch(own_m)
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
    lines = own_m.shape[0]

    half_step = 0.5 * mean_pitch(cross_m)
    strip_along = (cross_m[:, None] + half_step * gauss).ravel()
    strip_area = 0.5 * rim_m * jnp.tile(half_step * weight, cross_m.shape[0])
    outside = half_own + 0.5 * rim_m
    strip = jnp.ones_like(strip_along)
    return LinePoints(
        across_m=jnp.concatenate(
            [
                (own_m[:, None] + relative).ravel(),
                (own_m[0] - outside) * strip,
                (own_m[-1] + outside) * strip,
            ]
        ),
        along_m=jnp.concatenate([jnp.tile(jnp.concatenate(along), lines), strip_along, strip_along]),
        area_m2=jnp.concatenate([jnp.tile(jnp.concatenate(area), lines), strip_area, strip_area]),
        lines=lines,
        rim_points=strip_along.shape[0],
    )


def mean_pitch(line_m: Float[Array, " n"]) -> Float[Array, ""]:
    """Mean distance of neighbouring lines: line_m (n,) ascending [m]; returns [m]."""
    return (line_m[-1] - line_m[0]) / (line_m.shape[0] - 1)


def _collect(points: LinePoints, charge: Float[Array, " n*q+2*s"]) -> Float[Array, " n"]:
    """Charge of each line from the charge at its points."""
    strips = 2 * points.rim_points
    total = charge[:-strips].reshape(points.lines, -1).sum(axis=1)
    rim = charge[-strips:].reshape(2, -1).sum(axis=1)
    return total.at[0].add(rim[0]).at[-1].add(rim[1])


def array_response(
    rows: LinePoints,
    columns: LinePoints,
    location_m: Float[Array, "2"],
    radius_m: Float[Array, ""],
    row_depth_m: Float[Array, ""],
    column_depth_m: Float[Array, ""],
    pitch_m: Float[Array, ""],
) -> Float[Array, " r+c"]:
    """Response of all lines, rows first, to a grounded cylinder standing on the pad.

    Args: rows, columns: points of the lines; location_m (2,) x, y of the cylinder's axis [m]; radius_m [m];
    row_depth_m, column_depth_m depth of the layers below the cylinder's bottom [m]; pitch_m the pitch p [m].
    Returns: response (r + c,), dimensionless.
    """
    # One evaluation for both layers: a quarter of the code to compile and to run.
    x = jnp.concatenate([rows.along_m, columns.across_m])
    y = jnp.concatenate([rows.across_m, columns.along_m])
    area = jnp.concatenate([rows.area_m2, columns.area_m2])
    split = rows.area_m2.shape[0]
    depth = jnp.where(np.arange(area.shape[0]) < split, row_depth_m, column_depth_m)
    rho = jnp.sqrt((x - location_m[0]) ** 2 + (y - location_m[1]) ** 2 + _TINY_M**2)
    charge = area * disc_density(rho, radius_m, depth) * (2.0 / (jnp.pi * pitch_m**2))
    return jnp.concatenate([_collect(rows, charge[:split]), _collect(columns, charge[split:])])
