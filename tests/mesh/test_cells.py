"""Cells of all kinds cut into tetrahedra: volumes, matching faces whatever the numbers, curved edges."""

from itertools import pairwise
from pathlib import Path

import jax.numpy as jnp
import meshio
import numpy as np
import pytest

from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity
from softfuse.mesh.cells import LINEAR, QUADRATIC, Block, tetrahedra
from softfuse.mesh.files import read_mesh
from softfuse.mesh.orientation import oriented
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import TetMesh, volumes


def bricks(kinds: tuple[str, ...], *, shuffled: int = 0) -> tuple[np.ndarray, list[Block]]:
    """A row of unit cubes along x, each of hexahedra, wedges or pyramids, that share whole faces."""
    nodes = np.array([[x, y, z] for x in range(len(kinds) + 1) for y in (0, 1) for z in (0, 1)], float)
    number = np.random.default_rng(shuffled).permutation(len(nodes) + len(kinds))
    middles = np.array([[k + 0.5, 0.5, 0.5] for k in range(len(kinds))])
    placed = np.empty((len(number), 3))
    placed[number] = np.vstack([nodes, middles])
    cells = []
    for k, kind in enumerate(kinds):
        a, e = 4 * k, 4 * k + 4
        hexa = np.array([a, e, e + 2, a + 2, a + 1, e + 1, e + 3, a + 3])
        match kind:
            case "hexahedron":
                own = hexa[None]
            case "wedge":  # cut along a diagonal of the faces across z, which no neighbour shares
                own = hexa[[[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]]]
            case _:
                faces = [face for face in LINEAR["hexahedron"].faces]
                own = np.array([[*hexa[list(face)[::-1]], len(nodes) + k] for face in faces])
        cells.append(Block(kind, number[own], np.full(len(own), k)))
    return placed, cells


@pytest.mark.parametrize("shuffled", range(6))
@pytest.mark.parametrize(
    "kinds", [("hexahedron",), ("wedge",), ("pyramid",), ("hexahedron", "wedge", "pyramid", "hexahedron")]
)
def test_a_row_of_bricks_is_filled_once_and_has_no_inner_boundary(
    kinds: tuple[str, ...], shuffled: int
) -> None:
    mesh = oriented(tetrahedra(*bricks(kinds, shuffled=shuffled)))
    assert volumes(mesh).sum() == pytest.approx(len(kinds), rel=1e-12)
    np.testing.assert_allclose(np.bincount(mesh.region, weights=volumes(mesh)), 1.0)
    # Faces that do not match would stay in the boundary: 2 triangles for each square of the skin remain.
    faces = boundary_faces(mesh).faces
    a, b, c = (mesh.nodes[faces[:, k]] for k in range(3))
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(4 * len(kinds) + 2)


def test_collapsed_hexahedra_are_wedges() -> None:
    nodes = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1]], float)
    cell = np.array([[0, 1, 2, 2, 3, 4, 5, 5]])
    mesh = oriented(tetrahedra(nodes, [Block("hexahedron", cell, np.zeros(1, int))]))
    assert len(mesh.tets) == 3 and volumes(mesh).sum() == pytest.approx(0.5)


def quadratic_cell(kind: str, bend) -> tuple[np.ndarray, list[Block]]:
    """One quadratic cell: corners and middles of the straight unit cell, all moved by bend."""
    solid = QUADRATIC[kind]
    corners = {
        4: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        5: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]],
        6: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]],
        8: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    }[solid.corners]
    x = np.array(corners, float)
    x = bend(np.vstack([x, x[np.array(solid.edges)].mean(axis=1)]))
    return x, [Block(kind, np.arange(len(x))[None], np.zeros(1, int))]


@pytest.mark.parametrize("kind", ["tetra10", "pyramid13", "wedge15", "hexahedron20"])
def test_quadratic_cells_keep_their_curved_edges(kind: str) -> None:
    straight = {"tetra10": 1 / 6, "pyramid13": 1 / 3, "wedge15": 1 / 2, "hexahedron20": 1.0}[kind]

    def sheared(x: np.ndarray) -> np.ndarray:
        """z + 0.2 x² + 0.1 x y: of determinant 1, and within quadratic shape functions."""
        return x + np.outer(0.2 * x[:, 0] ** 2 + 0.1 * x[:, 0] * x[:, 1], [0.0, 0.0, 1.0])

    mesh = oriented(tetrahedra(*quadratic_cell(kind, sheared)))
    assert mesh.order == 2
    skin = Cavity(jnp.asarray(boundary_faces(mesh).faces))
    assert float(skin(jnp.asarray(mesh.nodes))) == pytest.approx(straight, rel=1e-12)
    flat = mesh.nodes - np.outer(sheared(mesh.nodes)[:, 2] - mesh.nodes[:, 2], [0.0, 0.0, 1.0])
    bottom = flat[:, 2] < 1e-9
    assert bottom.sum() >= 6
    np.testing.assert_allclose(flat[bottom, 2], 0.0, atol=1e-12)


def test_orders_are_not_mixed_and_unknown_kinds_are_counted() -> None:
    nodes, blocks = bricks(("hexahedron",))
    curved, extra = quadratic_cell("tetra10", lambda x: x)
    shifted = Block("tetra10", extra[0].cells + len(nodes), extra[0].region)
    with pytest.raises(MeshError, match=r"mixes linear and quadratic cells \(1 hexahedron, 1 tetra10\)"):
        tetrahedra(np.vstack([nodes, curved + 5]), [*blocks, shifted])
    odd = Block("tetra20", np.arange(40).reshape(2, 20), np.zeros(2, int))
    with pytest.raises(MeshError, match="2 tetra20 cannot be cut into tetrahedra: export"):
        tetrahedra(np.zeros((40, 3)), [*blocks, odd])


def test_hexahedra_and_tetrahedra_of_a_file_make_one_body(tmp_path: Path) -> None:
    nodes, blocks = bricks(("hexahedron", "pyramid"))
    meshio.Mesh(nodes, [(block.kind, block.cells) for block in blocks]).write(tmp_path / "two.vtu")
    mesh: TetMesh = read_mesh(tmp_path / "two.vtu", scale=1e-2)
    assert volumes(mesh).sum() == pytest.approx(2e-6)


def test_every_quadratic_kind_has_its_edges_in_order() -> None:
    for solid in {*LINEAR.values(), *QUADRATIC.values()}:
        around = {frozenset(pair) for face in solid.faces for pair in pairwise((*face, face[0]))}
        assert around == {frozenset(edge) for edge in solid.edges}
