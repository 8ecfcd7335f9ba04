"""Round trips through every format written, foreign files, and files that must be refused."""

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from softfuse.errors import MeshError
from softfuse.mesh.files import read_mesh, read_surface, write_mesh, write_surface
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.shell import checked, shell_of, shell_parts
from softfuse.mesh.surface import enclosed_volume
from softfuse.mesh.tetmesh import TetMesh, quadratic, volumes

TETRA = {1: "tetra", 2: "tetra10"}

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    + [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)


def raw_mesh(nodes: np.ndarray, *blocks: tuple[str, np.ndarray]) -> meshio.Mesh:
    return meshio.Mesh(nodes, [meshio.CellBlock(*block) for block in blocks])


@pytest.fixture(params=[1, 2])
def body(request: pytest.FixtureRequest, geometry: PadGeometry) -> TetMesh:
    mesh = pad_mesh(geometry, 0.1, 0.028)
    stiff = (mesh.nodes[mesh.corners].mean(axis=1)[:, 2] < 0.006).astype(np.int32)
    mesh = replace(mesh, region=3 * stiff)
    return mesh if request.param == 1 else quadratic(mesh)


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".msh", ".xdmf"])
def test_round_trip_keeps_nodes_tets_and_regions(body: TetMesh, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"pad{ending}"
    write_mesh(path, body, point_data={"u": body.nodes}, cell_data={"energy": volumes(body)})
    back = read_mesh(path)
    np.testing.assert_array_equal(back.nodes, body.nodes)
    np.testing.assert_array_equal(back.tets, body.tets)
    np.testing.assert_array_equal(back.region, body.region)
    np.testing.assert_array_equal(meshio.read(path).point_data["u"], body.nodes)


@pytest.mark.parametrize(
    ("ending", "kind"), [(".vtu", "vtu"), (".vtk", "vtk"), (".inp", "abaqus"), (".msh", "gmsh22")]
)
def test_other_cells_and_several_blocks_in_millimetres(
    body: TetMesh, tmp_path: Path, ending: str, kind: str
) -> None:
    tetra, middle = TETRA[body.order], len(body.tets) // 2
    blocks = [("triangle", body.tets[:5, :3]), (tetra, body.tets[:middle]), (tetra, body.tets[middle:])]
    nodes = np.vstack([1e3 * body.nodes, [0.0, 0.0, 99.0]])
    meshio.write(tmp_path / f"other{ending}", raw_mesh(nodes, *blocks), file_format=kind)
    mesh = read_mesh(tmp_path / f"other{ending}", scale=1e-3)
    np.testing.assert_allclose(mesh.nodes, body.nodes, atol=1e-12)
    np.testing.assert_array_equal(mesh.tets, body.tets)
    assert not mesh.region.any()


@pytest.mark.parametrize(("ending", "kind"), [(".msh", "gmsh"), (".med", "med"), (".xdmf", "xdmf")])
def test_formats_of_other_programs_without_regions(
    body: TetMesh, tmp_path: Path, ending: str, kind: str
) -> None:
    meshio.write(
        tmp_path / f"other{ending}", raw_mesh(body.nodes, (TETRA[body.order], body.tets)), file_format=kind
    )
    mesh = read_mesh(tmp_path / f"other{ending}")
    np.testing.assert_array_equal(mesh.tets, body.tets)
    assert not mesh.region.any()


def test_physical_groups_of_gmsh_become_regions(body: TetMesh, tmp_path: Path) -> None:
    tags = (7 + body.region).astype(np.int32)
    mesh = meshio.Mesh(
        body.nodes,
        [meshio.CellBlock(TETRA[body.order], body.tets)],
        cell_data={"gmsh:physical": [tags], "gmsh:geometrical": [tags]},
    )
    meshio.write(tmp_path / "a.msh", mesh, file_format="gmsh22")
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.msh").region, tags)


def test_the_other_node_order_is_repaired_on_reading(body: TetMesh, tmp_path: Path) -> None:
    mirrored = replace(body, nodes=body.nodes * [1, 1, -1])
    write_mesh(tmp_path / "mirrored.vtu", mirrored)
    np.testing.assert_allclose(volumes(read_mesh(tmp_path / "mirrored.vtu")), volumes(body))


def test_files_that_are_no_tetrahedral_mesh(body: TetMesh, tmp_path: Path) -> None:
    meshio.write(tmp_path / "skin.vtk", raw_mesh(body.nodes, ("triangle", body.tets[:, :3])))
    with pytest.raises(MeshError, match="holds no tetrahedra, only triangle"):
        read_mesh(tmp_path / "skin.vtk")
    both = [("tetra", body.tets[:5, :4]), ("tetra10", quadratic(body).tets[5:])]
    meshio.write(tmp_path / "both.vtk", raw_mesh(quadratic(body).nodes, *both))
    with pytest.raises(MeshError, match="mixes linear and quadratic"):
        read_mesh(tmp_path / "both.vtk")
    with pytest.raises(MeshError, match="there is no file"):
        read_mesh(tmp_path / "missing.vtu")


@pytest.mark.parametrize("ending", [".vtu", ".vtk", ".msh", ".xdmf"])
def test_a_damaged_file_is_told_in_one_line(body: TetMesh, tmp_path: Path, capfd, ending: str) -> None:
    whole = tmp_path / f"pad{ending}"
    write_mesh(whole, body)
    for content in (b"", b"rubbish", whole.read_bytes()[: whole.stat().st_size // 2]):
        broken = tmp_path / f"broken{ending}"
        broken.write_bytes(content)
        with pytest.raises(MeshError, match="cannot be read as a mesh") as told:
            read_mesh(broken)
        assert "\n" not in str(told.value)
    assert capfd.readouterr() == ("", "")


def test_a_node_that_is_not_a_number_is_named(body: TetMesh, tmp_path: Path) -> None:
    nodes = body.nodes.copy()
    nodes[7, 2] = np.nan
    write_mesh(tmp_path / "nan.vtu", replace(body, nodes=nodes))
    with pytest.raises(MeshError, match="node 7 has the position"):
        read_mesh(tmp_path / "nan.vtu")


def test_what_cannot_be_written_is_told(body: TetMesh, tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="not written as '.foo'"):
        write_mesh(tmp_path / "pad.foo", body)
    with pytest.raises(MeshError, match="the field 'u' has 3 values"):
        write_mesh(tmp_path / "pad.vtu", body, point_data={"u": np.zeros(3)})
    with pytest.raises(MeshError, match="cannot be written"):
        write_mesh(tmp_path / "missing" / "pad.vtu", body)
    with pytest.raises(MeshError, match="not written as '.step'"):
        write_surface(tmp_path / "pad.step", shell_of(body))


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply", ".off"])
def test_surfaces_round_trip_in_millimetres(body: TetMesh, tmp_path: Path, ending: str) -> None:
    shell = shell_of(body)
    write_surface(tmp_path / f"pad{ending}", shell, scale=1e3)
    back = read_surface(tmp_path / f"pad{ending}", scale=1e-3)
    assert len(back.nodes) == len(shell.nodes) and len(back.faces) == len(shell.faces)
    assert len(shell_parts(back)) == 5
    assert enclosed_volume(back.nodes, back.faces) == pytest.approx(volumes(body).sum(), rel=1e-6)


def test_cavities_are_wound_by_depth_whatever_the_file_says() -> None:
    inner, island = 0.25 + 0.5 * CUBE, 0.4 + 0.2 * CUBE
    nodes = np.vstack([CUBE, inner, island])
    for turn in range(8):
        parts = [SIDES[:, ::-1] if turn >> k & 1 else SIDES for k in range(3)]
        shell = checked(nodes, np.vstack([parts[0], parts[1] + 8, parts[2] + 16]))
        assert enclosed_volume(shell.nodes, shell.faces) == pytest.approx(1 - 0.5**3 + 0.2**3)


def test_an_open_surface_tells_how_open_and_where(tmp_path: Path) -> None:
    for ending in (".stl", ".obj"):
        path = tmp_path / f"open{ending}"
        write_surface(path, replace(checked(CUBE, SIDES), faces=SIDES[:-1].astype(np.int32)))
        with pytest.raises(MeshError, match=r"not watertight: 3 open edges, .* \[.*\] mm; close the hole"):
            read_surface(path)


@pytest.mark.parametrize(
    ("faces", "told"),
    [
        (np.vstack([SIDES[:1, ::-1], SIDES[1:]]), "wound inconsistently at 3 edges, the first near"),
        (
            np.vstack([SIDES, SIDES[:1], SIDES[:1, ::-1]]),
            "3 edges of the surface belong to more than two triangles",
        ),
        (SIDES[:0], "holds no triangles"),
        (np.array([[0, 1, 3], [0, 3, 1]]), "is flat"),
    ],
)
def test_surfaces_that_are_no_outline(faces: np.ndarray, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        checked(CUBE, faces)


def test_surface_files_that_cannot_be_used(tmp_path: Path) -> None:
    for name in ("a.stl", "b.ply", "c.obj", "d.xyzw"):
        (tmp_path / name).write_text("rubbish")
        with pytest.raises(MeshError, match=name):
            read_surface(tmp_path / name)
    with pytest.raises(MeshError, match="there is no file"):
        read_surface(tmp_path / "missing.stl")
    nodes = CUBE.copy()
    nodes[2, 0] = np.nan
    with pytest.raises(MeshError, match="corner 2 of the surface has the position"):
        checked(nodes, SIDES)
