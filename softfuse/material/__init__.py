"""Strain-energy densities, one per file."""

from softfuse.material.base import AbstractMaterial, lame_constants
from softfuse.material.corotational import Corotational
from softfuse.material.isotropic import AbstractIsotropic, Invariants
from softfuse.material.mooney_rivlin import MooneyRivlin
from softfuse.material.neo_hookean import NeoHookean
from softfuse.material.ogden import Ogden
from softfuse.material.saint_venant_kirchhoff import SaintVenantKirchhoff
from softfuse.material.silicones import SILICONES, silicone, silicone_of_stiffness
from softfuse.material.yeoh import Yeoh

__all__ = [
    "SILICONES",
    "AbstractIsotropic",
    "AbstractMaterial",
    "Corotational",
    "Invariants",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "SaintVenantKirchhoff",
    "Yeoh",
    "lame_constants",
    "silicone",
    "silicone_of_stiffness",
]
