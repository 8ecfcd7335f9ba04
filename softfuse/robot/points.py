"""Points of the material that are named: alone, and in a line."""

from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, model_validator

from softfuse.body.base import AbstractBody
from softfuse.io.quantity import wrong_value
from softfuse.io.settings import NotEmpty, Settings, Vector
from softfuse.mesh.tetmesh import edge_lengths, tet_mesh


def _apart(points: tuple[Vector, ...]) -> tuple[Vector, ...]:
    for k, (before, here) in enumerate(pairwise(points), start=1):
        if here == before:
            raise wrong_value("is the same point as the one before it: move or remove it", key=f"[{k}]")
    return points


Path3 = Annotated[tuple[Vector, ...], NotEmpty, AfterValidator(_apart)]
"""Points (g, 3) m along a line, each apart from the one before."""


def surface_tolerance(body: AbstractBody) -> float:
    """How far [m] outside a body points may be that are meant to be on its surface: a tenth of its mean edge.

    Where a mesh of edges ℓ has flat faces on a surface of radius r, what is on the surface is ℓ²/8r outside.
    """
    corners = tet_mesh(body.rest, np.asarray(body.tets)[:, :4])
    return 0.1 * float(edge_lengths(corners).mean())


class PointSettings(Settings):
    """A point (3,) m of the material whose position is reported."""

    name: str
    at: Vector


class CentrelineSettings(Settings):
    """Points (g, 3) m of the material from the base to the tip: the ends of the segments between them."""

    points: Path3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.points) < 2:
            raise wrong_value("a line has at least two points", key="points")
        return self
