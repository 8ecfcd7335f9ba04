"""Strain-energy densities, one per file."""

from softfuse.material.base import AbstractMaterial, lame_constants
from softfuse.material.neo_hookean import NeoHookean

__all__ = ["AbstractMaterial", "NeoHookean", "lame_constants"]
