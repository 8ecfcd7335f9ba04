"""Elements, and the energy, residual and tangent of a body made of them."""

from softfuse.body.body import (
    Body,
    element_tangents,
    lagrangian,
    mesh_for,
    residual,
    tangent_action,
    volume_ratios,
)
from softfuse.body.element import ELEMENTS, LINEAR, QUADRATIC, TAYLOR_HOOD, Element

__all__ = [
    "ELEMENTS",
    "LINEAR",
    "QUADRATIC",
    "TAYLOR_HOOD",
    "Body",
    "Element",
    "element_tangents",
    "lagrangian",
    "mesh_for",
    "residual",
    "tangent_action",
    "volume_ratios",
]
