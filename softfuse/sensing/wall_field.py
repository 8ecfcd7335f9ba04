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

_NEWTON_STEPS = 3  # from a lower bound of the root of a convex function: monotone, 1e-8 at worst


@jax.custom_jvp
def wall_density(xi: Float[Array, "..."]) -> Float[Array, "..."]:
    """Charge density relative to the plate capacitor's, as a function of distance from the indenter's wall.

    Args: xi (...) = pi s / (2 d), dimensionless, positive outside the wall.
    Returns: kappa (...), between 0 and 1, the root of 1/kappa - artanh(kappa) = xi.
    Newton's method runs on t = artanh(kappa), for which coth(t) - t - xi is convex and decreasing.
    """
    t = 0.5 * (jnp.sqrt(xi * xi + 4.0) - xi)
    for _ in range(_NEWTON_STEPS):
        coth = 1.0 / jnp.tanh(t)
        t = t + (coth - t - xi) / (coth * coth)
    return jnp.tanh(t)


@wall_density.defjvp
def _wall_density_jvp(primals, tangents):
    kappa = wall_density(primals[0])
    return kappa, -(kappa**2) * (1.0 - kappa**2) * tangents[0]


def disc_density(
    rho_m: Float[Array, " n"], radius_m: Float[Array, ""], depth_m: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Relative charge density at a distance from the axis of a grounded cylinder that stands over the plane.

    Args: rho_m (n,) distance from the axis [m], > 0; radius_m of the cylinder [m]; depth_m (n,) of the plane
    below its bottom [m].
    Returns: density (n,) relative to eps V / depth, dimensionless.
    """
    fringe = wall_density(0.5 * jnp.pi * (rho_m - radius_m) / depth_m)
    return fringe * jnp.where(rho_m > radius_m, radius_m / rho_m, 1.0)
