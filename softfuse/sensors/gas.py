"""Pressure in a sealed cavity to volume change and back.

    p_abs (V + V_dead)^κ = P0 (V0 + V_dead)^κ,   p_abs = P0 + p,   dV = V - V0:
    dV = (V0 + V_dead) ((1 + p/P0)^(-1/κ) - 1),   p = P0 ((1 + dV/(V0 + V_dead))^(-κ) - 1).

p [Pa] is the gauge pressure since the cavity was at rest under P0, positive when it is squeezed, so a
squeezed cavity has a negative dV, as with flow sensors. V_dead is the volume of tube and port: it does not
change, but its gas is compressed as well. κ = 1 isothermal (slower than about a second: the gas of a cavity a
few millimetres wide takes up the temperature of its walls within some tenths), κ = 1.4 adiabatic air. Source:
Navarro et al., RA-L 5(4), 2020, eqs. (5) to (7). Small signals: dV = -(V0 + V_dead) p / (κ P0).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

ATMOSPHERE_PA = 101325.0
"""Absolute pressure around what nobody has measured it for [Pa]."""


def tube_volume(length_m: Float[Array, " *k"], bore_m: Float[Array, " *k"]) -> Float[Array, " *k"]:
    """Volume π/4 d² l of a tube: length_m, bore_m (inner diameter) of any shape [m]; returns [m^3]."""
    return 0.25 * jnp.pi * bore_m**2 * length_m


def volume_change_of(
    gauge_Pa: Float[Array, " *k"],
    rest_m3: Float[Array, " *k"],
    dead_m3: Float[Array, " *k"],
    *,
    atmosphere: float | Float[Array, ""] = ATMOSPHERE_PA,
    exponent: float | Float[Array, ""] = 1.0,
) -> Float[Array, " *k"]:
    """Volume change of sealed cavities whose pressure has changed.

    Args: gauge_Pa pressure since rest [Pa]; rest_m3 the cavities' volume V0 at rest [m^3]; dead_m3 volume
    V_dead of tube and port [m^3]; atmosphere: absolute pressure P0 at rest [Pa]; exponent κ [-].
    Returns: dV of gauge_Pa's shape [m^3], > -(V0 + V_dead); infinite at vacuum, NaN below it.
    """
    # expm1 and log1p: the plain power loses 1e-16 P0 V0 to rounding, which is 1e-10 of a pressure of 0.1 Pa.
    strain = jnp.expm1(-jnp.log1p(gauge_Pa / atmosphere) / exponent)
    return (rest_m3 + dead_m3) * strain


def gauge_pressure_of(
    volume_change_m3: Float[Array, " *k"],
    rest_m3: Float[Array, " *k"],
    dead_m3: Float[Array, " *k"],
    *,
    atmosphere: float | Float[Array, ""] = ATMOSPHERE_PA,
    exponent: float | Float[Array, ""] = 1.0,
) -> Float[Array, " *k"]:
    """Pressure of sealed cavities whose volume has changed: the inverse of volume_change_of.

    Args: volume_change_m3 dV [m^3]; the others as in volume_change_of.
    Returns: gauge pressure since rest [Pa], > -P0; NaN where less than no volume is left.
    """
    strain = volume_change_m3 / (rest_m3 + dead_m3)
    return atmosphere * jnp.expm1(-exponent * jnp.log1p(strain))


def volume_change_sigma_of(
    gauge_Pa: Float[Array, " *k"],
    gauge_sigma_Pa: Float[Array, " *k"],
    rest_m3: Float[Array, " *k"],
    dead_m3: Float[Array, " *k"],
    *,
    atmosphere: float | Float[Array, ""] = ATMOSPHERE_PA,
    exponent: float | Float[Array, ""] = 1.0,
) -> Float[Array, " *k"]:
    """Standard deviation of volume_change_of due to that of the pressure, to first order.

        |d dV/d p| = (V0 + V_dead) / (κ P0) (1 + p/P0)^(-1/κ - 1).

    Args: gauge_sigma_Pa standard deviation of gauge_Pa [Pa]; the others as in volume_change_of.
    Returns: [m^3].
    """
    slope = jnp.exp(-(1.0 / exponent + 1.0) * jnp.log1p(gauge_Pa / atmosphere))
    return (rest_m3 + dead_m3) / (exponent * atmosphere) * slope * gauge_sigma_Pa
