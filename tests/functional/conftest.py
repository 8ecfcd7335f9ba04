"""Boxes of Kuhn tetrahedra, with holes and steps where boxes are left out."""

from collections.abc import Callable

import numpy as np
import pytest

from softfuse.functional.pressure_cells import PressureCells
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import TetMesh, tet_mesh


@pytest.fixture(scope="session")
def box() -> Callable[..., TetMesh]:
    """box(x, y, z): tetrahedra between the planes of three axes (m); `keep` leaves grid boxes out."""

    def build(x, y, z, *, keep=None) -> TetMesh:
        planes = tuple(np.asarray(p, float) for p in (x, y, z))
        kept = np.ones([len(p) - 1 for p in planes], bool) if keep is None else keep
        mesh = kuhn_grid(planes, kept, (0, 0, 0))
        return oriented(tet_mesh(mesh.nodes, mesh.tets))

    return build


@pytest.fixture(scope="session")
def shares() -> Callable[[PressureCells], np.ndarray]:
    """shares(cells): part (p, m) of each cell's force at each point."""
    return lambda cells: np.eye(cells.count)[np.asarray(cells.cell)] * np.asarray(cells.share)[:, None]
