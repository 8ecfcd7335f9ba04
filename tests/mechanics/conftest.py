"""Boxes of Kuhn tetrahedra, and a small soft pad that a disc presses from above."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import TAYLOR_HOOD, Body, Element, mesh_for
from softfuse.functional.contact import ContactSurface
from softfuse.material import NeoHookean
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import TetMesh, tet_mesh


@pytest.fixture(scope="session")
def box() -> Callable[..., TetMesh]:
    """box(x, y, z): tetrahedra between the planes of three axes (m)."""

    def build(x, y, z) -> TetMesh:
        planes = tuple(np.asarray(p, float) for p in (x, y, z))
        mesh = kuhn_grid(planes, np.ones([len(p) - 1 for p in planes], bool), (0, 0, 0))
        return oriented(tet_mesh(mesh.nodes, mesh.tets))

    return build


@pytest.fixture(scope="session")
def pad(box) -> Callable[..., tuple[Body, np.ndarray]]:
    """pad(element): 20 × 20 × 10 mm in 24 tetrahedra, E = 0.1 MPa, ν = 0.45, held below; and its skin."""

    def build(element: Element = TAYLOR_HOOD) -> tuple[Body, np.ndarray]:
        mesh = mesh_for(element, box([0.0, 0.009, 0.02], [0.0, 0.012, 0.02], [0.0, 0.01]))
        body = Body.from_mesh(
            mesh, [NeoHookean.from_young(1e5, 0.45)], mesh.nodes[:, 2] == 0.0, element=element
        )
        return body, boundary_faces(mesh).faces

    return build


@pytest.fixture(scope="session")
def top(pad) -> ContactSurface:
    """The pad's upper face, pressed downwards."""
    body, skin = pad()
    return ContactSurface.facing(skin, np.asarray(body.rest), np.array([0.0, 0.0, -1.0]))


@pytest.fixture(scope="session")
def generic() -> Callable[[Body, int], jnp.ndarray]:
    """generic(body, seed): unknowns (n,) of strains of some percent, and pressures of some percent of μ."""

    def build(body: Body, seed: int) -> jnp.ndarray:
        random = np.random.default_rng(seed)
        x = np.asarray(body.rest)
        size = np.ptp(x, axis=0).max()
        smooth = np.sin(x / size @ random.uniform(-2, 2, (3, 3))) * 0.03 * size
        z = 0.05 * random.normal(size=body.n + 1)
        z[np.asarray(body.displacement_index)] = smooth + random.normal(size=x.shape) * 1e-3 * size
        return jnp.asarray(z[:-1])

    return build
