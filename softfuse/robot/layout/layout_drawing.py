"""A block with cavities of any shape, drawn: numbers from which meshes of any fineness are made."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
from pydantic import Field

from softfuse.errors import MeshError
from softfuse.io.quantity import wrong_value
from softfuse.io.settings import NotEmpty, Vector
from softfuse.mesh.block import Fineness, finer_to_the_top, whole_block
from softfuse.mesh.drawing import AbstractBlockDrawing, BlockSource
from softfuse.robot.chamber_shapes import AnyCavityShape
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import TiedLayout
from softfuse.robot.layout.layout_mesh import layout_mesh
from softfuse.robot.layout.outline import Outline
from softfuse.robot.layout.thickness import wall_names, wall_thicknesses


@dataclass(frozen=True)
class LayoutDrawing(AbstractBlockDrawing):
    """Block size (3,) m; the shape and values (v,), see `CavityShape`, of each of its cavities."""

    size: tuple[float, float, float]
    cavities: tuple[tuple[CavityShape, tuple[float, ...]], ...]

    def centres(self):
        """Centres (k, 3) in m of the cavities."""
        found = [np.asarray(shape.centre(jnp.array(values))) for shape, values in self.cavities]
        return np.array(found).reshape(-1, 3)

    def layout(self) -> TiedLayout:
        """The layout without parameters; raises MeshError when the block has no volume."""
        named = [(shape, dict(zip(shape.names, values, strict=True))) for shape, values in self.cavities]
        return TiedLayout.of(Outline.of(whole_block(self.size)), named, ())

    def mesh(self, surface_size, base_size, *, growth=1.0, fine_depth=0.0):
        """Quadratic tetrahedra with curved walls; see `layout_mesh` for the errors, and MeshError where no
        wall is left.
        """
        layout = self.layout()
        longest = finer_to_the_top(self.size[2], surface_size, growth=growth, fine_depth=fine_depth)
        try:
            made = layout_mesh(layout, layout.start, Fineness(base_size, longest))
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

    def drawing(self, cavity_centres):
        """The layout with cavities at the centres (k, 3) m."""
        parts = zip(self.shapes, cavity_centres, strict=True)
        return LayoutDrawing(
            size=self.size,
            cavities=tuple((each.shape, tuple(each.values(centre).values())) for each, centre in parts),
        )

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
