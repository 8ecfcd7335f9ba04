"""A block with cavities of any shape, drawn: nothing of it is free.

It is what a pad's geometry is for equal boxes: numbers from which meshes of any fineness are made.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from softfuse.errors import MeshError
from softfuse.mesh.drawing import AbstractBlockDrawing
from softfuse.mesh.pad import finer_to_the_top
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import TiedLayout
from softfuse.robot.layout.layout_mesh import Fineness, layout_mesh
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
        return TiedLayout.of(Outline.of_size(self.size), named, ())

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


def _check_walls(layout: TiedLayout, error: MeshError) -> None:
    """Raise MeshError with the thinnest wall if there is none left, which may not be seen from an error."""
    thicknesses = np.asarray(wall_thicknesses(layout, jnp.asarray(layout.start)))
    thinnest = int(np.argmin(thicknesses))
    if thicknesses[thinnest] <= 0.0:
        raise MeshError(
            f"no wall is left between {wall_names(layout)[thinnest].replace(', ', ' and ')} (they overlap by "
            f"{-1e3 * thicknesses[thinnest]:.3g} mm): move the cavity away, or make it smaller"
        ) from error
