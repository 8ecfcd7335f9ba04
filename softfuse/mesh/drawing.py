"""What a block with cavities is to be like, before it is meshed: for whoever makes one of any size of mesh.

z runs from the bottom (0) to the top (size[2]); x and y are centred.
"""

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float

from softfuse.mesh.tetmesh import TetMesh


class AbstractBlockDrawing(ABC):
    """A block of a size (3,) m with closed cavities."""

    size: tuple[float, float, float]

    @abstractmethod
    def centres(self) -> Float[np.ndarray, "k 3"]:
        """Centres (k, 3) in m of the cavities, in the order of the config."""

    @abstractmethod
    def mesh(
        self, surface_size: float, base_size: float, *, growth: float = 1.0, fine_depth: float = 0.0
    ) -> TetMesh:
        """Tetrahedra, linear or not, with edges at the top of at most surface_size m from a grid of boxes of
        at most base_size m; lengths: see `pad_mesh`. Raises MeshError when there is no such mesh.
        """
