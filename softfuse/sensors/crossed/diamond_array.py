"""Response of crossed lines of diamond electrodes to a grounded cylinder.

Rows and columns are chains of diamonds that tile the plane: the diamonds of a column sit midway between the
rows' centre lines and the other way round, with half a diamond at both ends of every line. The response of a
line is the integral of the cylinder's charge density over the line's diamonds,

    f_k = (2 / (pi p^2)) * integral over the diamonds of line k of kappa(|r - r_contact|) dA,

dimensionless, p being the pitch: a cylinder of radius p, wholly over the array, gives about 1 in total over
the lines of a layer, since half of the area belongs to either layer. It is a Gauss quadrature, smooth in
everything.

The outermost lines also collect flux that passes the array's rim and would otherwise land beyond it. It is
modelled as a strip of width `rim` along the rim, half of which belongs to the outermost line.

Under the flat bottom of a grounded indenter, a distance d above the electrode plane, the charge density is
that of a plate capacitor, eps V / d; towards the rim it falls and continues as the fringe of the vertical
side wall. In the plane normal to the rim this is a potential problem with an exact solution. The
Schwarz-Christoffel map of the region between the plane and a block with flat bottom and vertical wall,
dz/dzeta = (d/pi) sqrt(1 + zeta)/zeta, gives the density relative to eps V / d as kappa with

    pi s / (2 d) = 1/kappa - artanh(kappa),

s being the distance from the wall (positive outside). kappa -> 1 far inside, kappa -> 2 d / (pi s) far
outside, kappa(0) = 0.834. Outside a round indenter of radius R the flux of the wall spreads over the growing
circumference, which multiplies kappa by R / rho. Sign: density is positive where the indenter adds
capacitance.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_GAUSS_POINTS = 4  # per side of a diamond: cells of 1.4 mm at 8 mm pitch, the fringe is 1 to 2 mm wide
_TINY_M = 1e-7  # keeps the distance from the axis differentiable at zero
# Artanh kappa less v for v of `wall_density`, over v^3: polynomials in v whose quotient fits it within 5e-5 v
# by least squares; from the lowest power, 1/3 being exact at 0 and equal highest ones at infinity.
_RISE_ABOVE = (1.0 / 3.0, -0.12640352, 0.19869732)
_RISE_BELOW = (1.0, -0.33160897, 0.7440277, 0.34486666, 0.07589466, 0.19869732)


class ArrayPoints(eqx.Module):
    """Quadrature points of all e lines, rows first, p each; those of lines with fewer are without area."""

    x_m: Float[Array, "e p"]
    """x [m]."""
    y_m: Float[Array, "e p"]
    """y [m]."""
    weight: Float[Array, "e p"]
    """Area over that of the diamonds of two crossed lines, 2 / (pi p^2) of it, p being the pitch."""


def array_points(
    row_y_m: Float[Array, " r"],
    column_x_m: Float[Array, " c"],
    row_rim_m: Float[Array, ""],
    column_rim_m: Float[Array, ""],
) -> ArrayPoints:
    """Points of both layers side by side, rows at y, columns at x, with strips as wide as their rims [m]."""
    own = line_points(row_y_m, column_x_m, row_rim_m), line_points(column_x_m, row_y_m, column_rim_m)
    most = max(across.shape[1] for across, _, _ in own)
    across, along, area = (
        [jnp.pad(value, ((0, 0), (0, most - value.shape[1]))) for value in each]
        for each in zip(*own, strict=True)
    )
    scale = 2.0 / (jnp.pi * mean_pitch(row_y_m) ** 2)
    return ArrayPoints(
        x_m=jnp.concatenate([along[0], across[1]]),
        y_m=jnp.concatenate([across[0], along[1]]),
        weight=scale * jnp.concatenate(area),
    )


def line_points(
    own_m: Float[Array, " n"], cross_m: Float[Array, " m"], rim_m: Float[Array, ""]
) -> tuple[Float[Array, "n q"], Float[Array, "n q"], Float[Array, "n q"]]:
    """Gauss points of the diamonds of parallel lines, and of the strips along their rim, line by line.

    Args: own_m (n,) centre lines' coordinate across the lines [m]; cross_m (m,) coordinate of the lines
    that cross them [m]; both ascending, at least two; rim_m width of the strips [m].
    Returns: coordinates across and along the lines (n, q) [m], and areas (n, q) [m²]; the last points of the
    outermost lines are those of the strips, without area in the others.
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
    half_step = 0.5 * mean_pitch(cross_m)
    strip_along = (cross_m[:, None] + half_step * gauss).ravel()
    strip_area = 0.5 * rim_m * jnp.tile(half_step * weight, cross_m.shape[0])
    outside = half_own + 0.5 * rim_m
    strip = jnp.ones_like(strip_along)

    def each_line(diamonds: Array, first: Array, last: Array) -> Array:
        """Points of the diamonds (n, q), and of the strips (s,) for the outermost lines."""
        between = jnp.zeros((own_m.shape[0] - 2, strip.shape[0]), strip.dtype)
        return jnp.concatenate([diamonds, jnp.concatenate([first[None], between, last[None]])], axis=1)

    def alike(values: list[Array], strip: Array) -> Array:
        return each_line(jnp.tile(jnp.concatenate(values), (own_m.shape[0], 1)), strip, strip)

    own = own_m[:, None] + jnp.concatenate(across)
    across_m = each_line(own, (own_m[0] - outside) * strip, (own_m[-1] + outside) * strip)
    return across_m, alike(along, strip_along), alike(area, strip_area)


@jax.custom_jvp
def wall_density(xi: Float[Array, "..."]) -> Float[Array, "..."]:
    """Charge density relative to the plate capacitor's, as a function of distance from the indenter's wall.

    Args: xi (...) = pi s / (2 d), dimensionless, positive outside the wall.
    Returns: kappa (...), between 0 and 1, the root of 1/kappa - artanh(kappa) = xi.
    With t = artanh(kappa) that is coth(t) - t = xi. It begins at the root v of 1/v - v = xi plus a fitted
    quotient, and takes one step of Newton's method and the tangent's curvature along it: 1e-8 at worst.
    """
    far = 0.5 * (jnp.sqrt(xi * xi + 4.0) + jnp.abs(xi))  # the roots are this and its inverse
    v = jnp.where(xi > 0.0, 1.0 / far, far)
    t = v + v**3 * _polynomial(_RISE_ABOVE, v) / _polynomial(_RISE_BELOW, v)
    kappa = jnp.tanh(t)
    step = (1.0 / kappa - t - xi) * kappa * kappa
    return kappa + (1.0 - kappa * kappa) * step * (1.0 - kappa * step)


def _polynomial(coefficients: tuple[float, ...], v: Float[Array, "..."]) -> Float[Array, "..."]:
    """Horner's scheme, from the lowest power."""
    value = jnp.full_like(v, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * v + coefficient
    return value


@wall_density.defjvp
def _wall_density_jvp(primals, tangents):
    kappa = wall_density(primals[0])
    return kappa, -(kappa**2) * (1.0 - kappa**2) * tangents[0]


def disc_density(
    rho_m: Float[Array, "..."], radius_m: Float[Array, ""], depth_m: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Relative charge density at a distance from the axis of a grounded cylinder that stands over the plane.

    Args: rho_m (...) distance from the axis [m], > 0; radius_m of the cylinder [m]; depth_m (...) of the
    plane below its bottom [m].
    Returns: density (...) relative to eps V / depth, dimensionless.
    """
    fringe = wall_density(0.5 * jnp.pi * (rho_m - radius_m) / depth_m)
    return fringe * jnp.where(rho_m > radius_m, radius_m / rho_m, 1.0)


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
