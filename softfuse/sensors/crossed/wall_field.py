"""Field that a grounded indenter leaves on the plane of the electrodes below it.

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

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# Artanh kappa less v for v of `wall_density`, over v^3: polynomials in v whose quotient fits it within 5e-5 v
# by least squares; from the lowest power, 1/3 being exact at 0 and equal highest ones at infinity.
_RISE_ABOVE = (1.0 / 3.0, -0.12640352, 0.19869732)
_RISE_BELOW = (1.0, -0.33160897, 0.7440277, 0.34486666, 0.07589466, 0.19869732)


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
