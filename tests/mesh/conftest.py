"""The pad of the paper (design, Sec. 7) and small meshes that the tests of this folder share."""

import numpy as np
import pytest

from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.tetmesh import TetMesh, tet_mesh


@pytest.fixture(scope="session")
def geometry() -> PadGeometry:
    centres = ((-0.017, -0.017), (-0.017, 0.017), (0.017, -0.017), (0.017, 0.017))
    return PadGeometry((0.08, 0.08, 0.018), (0.028, 0.028, 0.006), centres, 0.006)


@pytest.fixture(scope="session")
def pad(geometry: PadGeometry) -> TetMesh:
    return pad_mesh(geometry, 0.014, 0.014, growth=1.0, fine_depth=0.006)


@pytest.fixture
def two_tets() -> TetMesh:
    """Two positive tetrahedra on opposite sides of the face 1, 2, 3."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])
    return tet_mesh(nodes, [[0, 1, 2, 3], [4, 1, 3, 2]])
