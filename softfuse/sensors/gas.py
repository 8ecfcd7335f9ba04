"""Pressure in a sealed cavity to volume change.

    p_abs (V + V_dead)^κ = P0 (V0 + V_dead)^κ,   p_abs = P0 + p,   dV = V - V0:
    dV = (V0 + V_dead) ((1 + p/P0)^(-1/κ) - 1).

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
