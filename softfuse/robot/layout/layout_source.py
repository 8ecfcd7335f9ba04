"""A block with cavities of any shape, drawn: numbers from which meshes of any fineness are made."""

from collections.abc import Sequence
from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
from pydantic import Field

from softfuse.errors import MeshError
from softfuse.io.quantity import wrong_value
from softfuse.io.settings import NotEmpty, Vector
from softfuse.mesh.block import NO_BOXES, Fineness
from softfuse.mesh.body_source import BlockSource
from softfuse.mesh.shell import Shell
from softfuse.mesh.tetmesh import TetMesh
from softfuse.robot.chamber_shapes import AnyCavityShape
from softfuse.robot.layout.layout import TiedLayout
from softfuse.robot.layout.layout_mesh import layout_mesh
from softfuse.robot.layout.thickness import wall_names, wall_thicknesses


def drawn_mesh(layout: TiedLayout, fineness: Fineness) -> TetMesh:
    """Quadratic tetrahedra with curved walls, as drawn; see `layout_mesh` for the errors, and MeshError where
    no wall is left.
    """
    try:
        made = layout_mesh(layout, layout.start, fineness)
    except MeshError as error:
        _check_walls(layout, error)
        raise
    return made.mesh(layout.start)


class LayoutSource(BlockSource):
    """A block with cavities of any shape, each with a table in the order of [[chamber]], which has its
    centre.
    """

    type: Literal["layout"]
    shapes: Annotated[tuple[AnyCavityShape, ...], NotEmpty] = Field(alias="shape")

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The layout, meshed; see `drawn_mesh` for the errors."""
        parts = zip(self.shapes, cavity_centres, strict=True)
        drawn = [(each.shape, each.values(centre)) for each, centre in parts]
        return drawn_mesh(TiedLayout.of(self.outside(), drawn, ()), self.fineness(NO_BOXES))

    def check_cavities(self, centres: Sequence[Vector]) -> None:
        """There are as many shapes as cavities."""
        if len(self.shapes) != len(centres):
            raise wrong_value(
                f"{len(self.shapes)} shapes for {len(centres)} cavities: give one for each [[chamber]], in "
                "their order",
                key="body.source.shape",
            )


def _check_walls(layout: TiedLayout, error: MeshError) -> None:
    """Raise MeshError with the thinnest wall if there is none left, which may not be seen from an error."""
    thicknesses = np.asarray(wall_thicknesses(layout, jnp.asarray(layout.start)))
    thinnest = int(np.argmin(thicknesses))
    if thicknesses[thinnest] <= 0.0:
        raise MeshError(
            f"no wall is left between {wall_names(layout)[thinnest].replace(', ', ' and ')} (they overlap by "
            f"{-1e3 * thicknesses[thinnest]:.3g} mm): move the cavity away, or make it smaller"
        ) from error
