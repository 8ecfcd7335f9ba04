"""Elements, and the energy, residual and tangent of a body made of them."""

from softfuse.body.base import AbstractBody
from softfuse.body.body import Body, mesh_for
from softfuse.body.element import ELEMENTS, LINEAR, QUADRATIC, TAYLOR_HOOD, Element

__all__ = [
    "ELEMENTS",
    "LINEAR",
    "QUADRATIC",
    "TAYLOR_HOOD",
    "AbstractBody",
    "Body",
    "Element",
    "mesh_for",
]
