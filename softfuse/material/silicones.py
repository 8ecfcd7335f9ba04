"""Yeoh constants of common casting silicones, from uniaxial tension to failure, and their densities.

They follow the tests to within 3 % from 50 % to 200 % strain; far beyond, c₃ < 0 makes them too soft. Other
sources differ by a factor of two (cure, batch, Mullins softening): calibrate every robot.
Source: Marechal et al., Toward a Common Framework and Database of Materials for Soft Robotics, Soft
Robotics 8 (2021) 284, and its tensile tests (github.com/LucMarechal/Soft-Robotics-Materials-Database);
densities: Smooth-On, technical bulletins of the Ecoflex and the Dragon Skin series.
"""

from dataclasses import dataclass
from types import MappingProxyType

from softfuse.errors import ConfigError
from softfuse.material.yeoh import Yeoh


@dataclass(frozen=True)
class Silicone:
    """Trade name, constants (c1, c2, c3) [Pa] of the Yeoh law, density [kg/m³]."""

    name: str
    yeoh: tuple[float, float, float]
    density: float


POISSON = 0.49
"""Poisson's ratio [-] where nobody gives one."""

_TABLE = (
    Silicone("Ecoflex 00-30", (7.73e3, 0.140e3, -0.004e3), 1070.0),
    Silicone("Ecoflex 00-50", (10.4e3, 0.349e3, -0.011e3), 1070.0),
    Silicone("Dragon Skin 10", (21.6e3, 3.04e3, -0.112e3), 1070.0),
    Silicone("Dragon Skin 20", (63.6e3, 7.45e3, -0.295e3), 1080.0),
    Silicone("Dragon Skin 30", (92.0e3, 9.09e3, -0.364e3), 1080.0),
)

SILICONES = MappingProxyType({each.name.lower(): each for each in _TABLE})
"""By name in lower case."""


def silicone(name: str, poisson: float) -> Yeoh:
    """The Yeoh law of a silicone by its trade name, with a Poisson's ratio [-].

    Raises ConfigError when the name is not in `SILICONES`.
    """
    return Yeoh.from_poisson(*_constants(name), poisson)


def silicone_of_stiffness(name: str, shear_modulus: float, poisson: float) -> Yeoh:
    """The Yeoh law of a silicone, all constants scaled so that small strains have a shear modulus [Pa].

    It stiffens with strain as that silicone does. Raises ConfigError when the name is not in `SILICONES`.
    """
    c1, c2, c3 = _constants(name)
    scale = shear_modulus / (2.0 * c1)
    return Yeoh.from_poisson(scale * c1, scale * c2, scale * c3, poisson)


def _constants(name: str) -> tuple[float, float, float]:
    found = SILICONES.get(name.lower())
    if found is None:
        names = ", ".join(each.name for each in _TABLE)
        raise ConfigError(f"silicone {name!r} is not known: give one of {names}, or its constants")
    return found.yeoh
