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

from softfuse.sensors.crossed.wall_field import disc_density, wall_density

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


class ArrayPoints(eqx.Module):
    """Quadrature points of all e lines, rows first, p each; those of lines with fewer are without area."""

    x_m: Float[Array, "e p"]
    """x [m]."""
    y_m: Float[Array, "e p"]
    """y [m]."""
    weight: Float[Array, "e p"]
    """Area over that of the diamonds of two crossed lines, 2 / (pi p^2) of it, p being the pitch."""


def array_points(rows: LinePoints, columns: LinePoints, pitch_m: Float[Array, ""]) -> ArrayPoints:
    """Points of both layers side by side: rows, columns; pitch_m the pitch p [m]."""
    own = [_line_by_line(points) for points in (rows, columns)]
    most = max(across.shape[1] for across, _, _ in own)
    across, along, area = (
        [jnp.pad(value, ((0, 0), (0, most - value.shape[1]))) for value in each]
        for each in zip(*own, strict=True)
    )
    scale = 2.0 / (jnp.pi * pitch_m**2)
    return ArrayPoints(
        x_m=jnp.concatenate([along[0], across[1]]),
        y_m=jnp.concatenate([across[0], along[1]]),
        weight=scale * jnp.concatenate(area),
    )


def _line_by_line(points: LinePoints) -> tuple[Array, Array, Array]:
    """Across, along and area, (n, q + s) each: the outermost lines own the strips."""
    strips = 2 * points.rim_points

    def lined(value: Array, between: float) -> Array:
        first, last = value[-strips:].reshape(2, -1)
        inner = jnp.full((points.lines - 2, points.rim_points), between, value.dtype)
        rim = jnp.concatenate([first[None], inner, last[None]])
        return jnp.concatenate([value[:-strips].reshape(points.lines, -1), rim], axis=1)

    return lined(points.across_m, 0.0), lined(points.along_m, 0.0), lined(points.area_m2, 0.0)


def array_response(
    points: ArrayPoints,
    location_m: Float[Array, "2"],
    radius_m: Float[Array, ""],
    depth_m: Float[Array, " e"],
) -> Float[Array, " e"]:
    """Response of all lines, rows first, to a grounded cylinder standing on the body.

    Args: location_m (2,) x, y of the cylinder's axis [m]; radius_m [m]; depth_m (e,) of the lines below the
    cylinder's bottom [m].
    Returns: response (e,), dimensionless.
    """
    rho = _distance(points, location_m)
    return jnp.sum(points.weight * disc_density(rho, radius_m, depth_m[:, None]), axis=1)


def array_slopes(
    points: ArrayPoints,
    location_m: Float[Array, "2"],
    radius_m: Float[Array, ""],
    depth_m: Float[Array, " e"],
) -> tuple[Float[Array, " e"], Float[Array, "e 4"]]:
    """The response of `array_response`, and its derivatives by x, y [1/m], radius [1/m] and depth [1/m].

    With w = pi / (2 d), xi = w (rho - R) and kappa' = -kappa^2 (1 - kappa^2), written out because all five
    are sums of the same few numbers at each point: automatic derivatives cost twice as much.
    """
    rho = _distance(points, location_m)
    wide = 0.5 * jnp.pi / depth_m
    kappa = wall_density(wide[:, None] * (rho - radius_m))
    outside = rho > radius_m
    charge = points.weight * kappa * jnp.where(outside, radius_m / rho, 1.0)
    spread = jnp.where(outside, charge, 0.0)
    by_xi = -charge * kappa * (1.0 - kappa * kappa)
    by_rho = (by_xi * wide[:, None] - spread / rho) / rho
    # Products with ones: sums inside a loop over points are not vectorised.
    ones = jnp.ones(rho.shape[1], rho.dtype)
    of_radius = (spread @ ones) / radius_m - wide * (by_xi @ ones)
    of_depth = -wide / depth_m * ((by_xi * (rho - radius_m)) @ ones)
    of_x = (by_rho * (location_m[0] - points.x_m)) @ ones
    of_y = (by_rho * (location_m[1] - points.y_m)) @ ones
    return charge @ ones, jnp.stack([of_x, of_y, of_radius, of_depth], axis=1)


def _distance(points: ArrayPoints, location_m: Float[Array, "2"]) -> Float[Array, "e p"]:
    return jnp.sqrt((points.x_m - location_m[0]) ** 2 + (points.y_m - location_m[1]) ** 2 + _TINY_M**2)


def mean_pitch(line_m: Float[Array, " n"]) -> Float[Array, ""]:
    """Mean distance of neighbouring lines: line_m (n,) ascending [m]; returns [m]."""
    return (line_m[-1] - line_m[0]) / (line_m.shape[0] - 1)
