"""Named groups and cells of Gmsh and Abaqus files, and endings that do not say what a file holds."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from softfuse.errors import MeshError
from softfuse.mesh.abaqus import read_abaqus
from softfuse.mesh.files import read_mesh, read_surface, write_mesh
from softfuse.mesh.gmsh import read_gmsh_41
from softfuse.mesh.groups import group_nodes
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.tetmesh import quadratic, tet_mesh, volumes

GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
2 5 "base"
3 5 "soft"
$EndPhysicalNames
$Entities
0 0 2 2
1 0 0 0 1 1 0 1 5 0
2 0 0 0 1 1 1 0 0
1 0 0 0 1 1 1 {body} 0
2 0 0 0 1 1 2 0 0
$EndEntities
$Nodes
1 5 1 5
3 1 0 5
1
2
3
4
5
0 0 0
1 0 0
0 1 0
0 0 1
1 1 1
$EndNodes
$Elements
4 4 1 4
2 1 2 1
1 1 2 3
2 2 2 1
2 2 3 5
3 1 4 1
3 1 2 3 4
3 2 4 1
4 2 3 4 5
$EndElements
"""


@pytest.mark.parametrize(("body", "regions"), [("0", [0, 0]), ("1 5", [0, 5])])
def test_groups_of_gmsh_may_cover_a_part(tmp_path: Path, body: str, regions: list[int], caplog) -> None:
    path = tmp_path / "part.msh"
    path.write_text(GMSH.format(body=body))
    mesh = read_mesh(path)
    assert sorted(mesh.region.tolist()) == regions
    assert ("1 of 2 tetrahedra are in no group: region 0" in caplog.text) == (body != "0")
    assert group_nodes(mesh, "base").tolist() == [True, True, True, False, False]
    # With a node in the middle of each edge those of the face are in it too: 3 of 9.
    assert group_nodes(quadratic(mesh), "base").sum() == 6
    np.testing.assert_array_equal(group_nodes(mesh, "5"), group_nodes(mesh, "base"))
    if body != "0":
        assert group_nodes(mesh, "soft").sum() == 4
    with pytest.raises(MeshError, match='no group "top", its groups are: "5", "base"'):
        group_nodes(mesh, "top")


def test_a_damaged_gmsh_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "cut.msh"
    path.write_text(GMSH.format(body="0").split("$Elements")[0])
    with pytest.raises(MeshError, match=r"cannot be read as a mesh \(no \$Nodes or no \$Elements\)"):
        read_gmsh_41(path)


ABAQUS = """*Heading
** a comment
*Part, name=Body
*NODE, nset=everything
1, 0., 0., 0.
2, 1., 0., 0.
30, 0., 1., 0.
4, 0., 0., 1.
5, 1., 1., 1.
*Element, type={kind}, elset=soft
1, 1, 2, 30, 4
7, 5, 2, 4, 30
*Element, type=T3D2
9, 1, 2
*Nset, nset=Base
1, 2,
30
*Nset, nset=range, generate
1, 5, 1
*Elset, elset=first
1
*Surface, type=ELEMENT, name=under
first, S1
*End Part
"""


@pytest.mark.parametrize("kind", ["C3D4", "C3D4H", "c3d4", "C3D4T"])
def test_all_kinds_of_abaqus_tetrahedra_and_sets_are_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "body.inp"
    path.write_text(ABAQUS.format(kind=kind).replace("1, 5, 1", "1, 4, 3"))
    mesh = read_mesh(path)
    assert len(mesh.tets) == 2 and volumes(mesh).sum() == pytest.approx(1 / 6 + 1 / 3)
    assert group_nodes(mesh, "Base").tolist() == [True, True, True, False, False]
    assert group_nodes(mesh, "range").tolist() == [True, False, False, True, False]
    np.testing.assert_array_equal(group_nodes(quadratic(mesh), "under"), group_nodes(quadratic(mesh), "Base"))
    assert group_nodes(mesh, "first").sum() == 4 and group_nodes(mesh, "soft").all()


@pytest.mark.parametrize("kind", ["C3D10", "C3D10H", "C3D10M", "C3D10MH", "C3D10HS"])
def test_quadratic_abaqus_tetrahedra(tmp_path: Path, kind: str) -> None:
    grid = kuhn_grid((np.arange(2.0),) * 3, np.ones((1, 1, 1), bool), (0, 0, 0))
    mesh = quadratic(tet_mesh(grid.nodes, grid.tets))
    rows = ["*NODE", *(f"{k + 1}, {x}, {y}, {z}" for k, (x, y, z) in enumerate(mesh.nodes.tolist()))]
    rows += [
        f"*ELEMENT, TYPE={kind}",
        *(f"{k + 1}, {str((t + 1).tolist())[1:-1]}" for k, t in enumerate(mesh.tets)),
    ]
    (tmp_path / "q.inp").write_text("\n".join(rows))
    found = read_mesh(tmp_path / "q.inp")
    assert found.order == 2 and volumes(found).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("7, 5, 2, 4, 30", "7, 5, 2, 4, 99", "there is no node 99"),
        ("7, 5, 2, 4, 30", "7, 5, 2, 4", r"line 10: \*ELEMENT cannot be read \(not all of the elements C3D4"),
        ("*End Part", "*NODE\n1, 0, 0, 9", "several parts with nodes of the same numbers"),
        ("*End Part", "*INCLUDE, INPUT=b.inp", "names another file"),
        ("*Element, type=C3D4,", "*Element, type=C3D27,", "an element C3D27 of 27 nodes"),
    ],
)
def test_what_is_wrong_in_an_abaqus_file_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "body.inp"
    path.write_text(ABAQUS.format(kind="C3D4").replace(old, new))
    with pytest.raises(MeshError, match=told):
        read_abaqus(path)


def test_tags_of_faces_and_fields_of_nodes_are_groups(tmp_path: Path) -> None:
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    cells = [("triangle", [[0, 1, 2], [0, 1, 3]]), ("tetra", [[0, 1, 2, 3]])]
    medit = meshio.Mesh(nodes, cells, cell_data={"medit:ref": [np.array([3, 4]), np.array([3])]})
    medit.write(tmp_path / "body.mesh")
    assert group_nodes(read_mesh(tmp_path / "body.mesh"), "3").tolist() == [True, True, True, False]
    mesh = tet_mesh(nodes, cells[1][1])
    for ending in ("vtu", "msh"):
        held = np.array([1, 0, 0, 1], np.int32)
        write_mesh(tmp_path / f"own.{ending}", mesh, point_data={"fixed": held})
        assert group_nodes(read_mesh(tmp_path / f"own.{ending}"), "fixed").tolist() == [
            True,
            False,
            False,
            True,
        ]


@pytest.mark.parametrize(
    ("ending", "content", "told"),
    [
        (
            ".vtu",
            GMSH.format(body="0"),
            "holds a Gmsh mesh, which its ending '.vtu' does not say: rename it to a.msh",
        ),
        (".msh", "# vtk DataFile Version 5.1\n", "holds a legacy VTK file"),
        (".vtk", '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid">', "holds a VTU file"),
        (".msh", ABAQUS.format(kind="C3D4"), "holds an Abaqus input file"),
        (".vtu", "solid a\n facet normal 0 0 1\n", "holds an STL surface"),
        (".inp", "ISO-10303-21;\nHEADER;", "holds a STEP file"),
    ],
)
def test_an_ending_that_does_not_say_what_is_inside(
    tmp_path: Path, ending: str, content: str, told: str
) -> None:
    path = tmp_path / f"a{ending}"
    path.write_text(content)
    with pytest.raises(MeshError, match=told):
        read_mesh(path)
    if ending == ".vtu":
        stl = path.with_suffix(".obj")
        stl.write_bytes(path.read_bytes())
        with pytest.raises(MeshError, match=told.split(",")[0]):
            read_surface(stl)
