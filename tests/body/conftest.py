"""Boxes of tetrahedra, and Newton's method on chosen unknowns by scipy's sparse LU.

Nothing here comes from `softfuse.mechanics`, so that bodies are tested on their own.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from softfuse.body import Body
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import TetMesh, tet_mesh

_tangents = jax.jit(Body.element_tangents)
_residual = jax.jit(Body.residual)


def _assembled(body: Body, tangents: np.ndarray) -> csc_array:
    index = np.asarray(body.element_unknowns)
    rows = np.broadcast_to(index[:, :, None], tangents.shape).ravel()
    columns = np.broadcast_to(index[:, None, :], tangents.shape).ravel()
    kept = (rows < body.n) & (columns < body.n)
    return csc_array((tangents.ravel()[kept], (rows[kept], columns[kept])), shape=(body.n, body.n))


@pytest.fixture(scope="session")
def box() -> Callable[..., TetMesh]:
    """box(planes): tetrahedra between the planes of three axes; `keep` leaves grid boxes out."""

    def build(planes, keep=None) -> TetMesh:
        kept = np.ones([len(p) - 1 for p in planes], bool) if keep is None else keep
        mesh = kuhn_grid(tuple(planes), kept, (0, 0, 0))
        return oriented(tet_mesh(mesh.nodes, mesh.tets))

    return build


@pytest.fixture(scope="session")
def irregular(box) -> Callable[..., TetMesh]:
    """irregular(n, size): a cube of side `size` m, n boxes an axis, its inner nodes moved at random."""

    def build(n: int, size: float = 1.0) -> TetMesh:
        mesh = box([np.linspace(0.0, size, n + 1)] * 3)
        inner = np.all((mesh.nodes > 0) & (mesh.nodes < size), axis=1)
        shift = np.random.default_rng(n).uniform(-0.12, 0.12, mesh.nodes.shape) * size / n
        return tet_mesh(mesh.nodes + inner[:, None] * shift, mesh.tets, region=mesh.region)

    return build


@pytest.fixture(scope="session")
def tangents() -> Callable[[Body, jax.Array], jax.Array]:
    """tangents(body, z): the element tangents (e, d, d), compiled once for all tests."""
    return _tangents


@pytest.fixture(scope="session")
def assembled() -> Callable[[Body, jax.Array], csc_array]:
    """assembled(body, z): the tangent K(z) (n, n) as a scipy matrix."""
    return lambda body, z: _assembled(body, np.asarray(_tangents(body, z)))


@pytest.fixture(scope="session")
def equilibrate(assembled) -> Callable[..., np.ndarray]:
    """equilibrate(body, z, free, load): z where r(z) = load on the unknowns `free`, the others held."""

    def solve(body, z, free, load=None, *, tolerance=1e-12):
        load = np.zeros(body.n) if load is None else np.asarray(load)
        z = np.array(z)
        for _ in range(15):
            left = (load - np.asarray(_residual(body, jnp.asarray(z))))[free]
            matrix = assembled(body, jnp.asarray(z))[free][:, free].tocsc()
            step = splu(matrix).solve(left)
            z[free] += step
            moved = step[free < body.n_displacements]
            if np.max(np.abs(moved), initial=0.0) <= tolerance * float(np.ptp(body.rest)):
                return z
        raise AssertionError(
            f"Newton's method of the test did not converge: last step {np.abs(moved).max()} m"
        )

    return solve
