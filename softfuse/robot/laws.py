"""From settings to strain-energy densities."""

import numpy as np

from softfuse.material import (
    AbstractMaterial,
    Corotational,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    SaintVenantKirchhoff,
    Yeoh,
)
from softfuse.robot.body import BodySettings
from softfuse.robot.material import (
    CorotationalSettings,
    Material,
    MooneyRivlinSettings,
    NeoHookeanSettings,
    OgdenSettings,
    SaintVenantKirchhoffSettings,
    YeohSettings,
)


def materials_of(body: BodySettings) -> tuple[AbstractMaterial, ...]:
    """The materials of the regions 0, 1 ... of a body."""
    return tuple(_law(settings) for settings in body.materials)


def _law(settings: Material) -> AbstractMaterial:
    match settings:
        case NeoHookeanSettings():
            return NeoHookean.from_young(settings.young, settings.poisson)
        case SaintVenantKirchhoffSettings():
            return SaintVenantKirchhoff.from_young(settings.young, settings.poisson)
        case CorotationalSettings():
            return Corotational.from_young(settings.young, settings.poisson)
        case MooneyRivlinSettings():
            return MooneyRivlin(settings.c10, settings.c01, settings.lame)
        case YeohSettings():
            return Yeoh(settings.c1, settings.c2, settings.c3, settings.lame)
        case OgdenSettings():
            return Ogden(np.array(settings.mu), np.array(settings.alpha), settings.lame)
