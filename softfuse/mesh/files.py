"""Meshes and surfaces in files.

Solid cells: everything that meshio reads (VTK, VTU, XDMF, MED, medit ...), Gmsh and Abaqus; what is no
tetrahedron is cut into some (`cells`). Surfaces: STL, OBJ, PLY, OFF, through trimesh; STEP (`step`).

XDMF and MED files go through h5py. The order of nodes in a quadratic tetrahedron is meshio's tetra10 (VTK's)
whatever the file format. Material regions are taken from the cell data "region", else from a Gmsh file's
physical groups, else from MED's "cell_tags" or medit's references; cells without any are region 0.
"""

import contextlib
import io
import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from softfuse.errors import MeshError
from softfuse.mesh.abaqus import read_abaqus
from softfuse.mesh.cells import Block, tetrahedra
from softfuse.mesh.file_kind import check_ending
from softfuse.mesh.gmsh import is_gmsh_41, read_gmsh_41
from softfuse.mesh.groups import TAGS, file_groups
from softfuse.mesh.orientation import oriented
from softfuse.mesh.shell import Shell, checked
from softfuse.mesh.step import read_step
from softfuse.mesh.tetmesh import TetMesh

log = logging.getLogger(__name__)

_CELLS = {1: "tetra", 2: "tetra10"}
_WRITTEN = {".vtu": "vtu", ".vtk": "vtk", ".msh": "gmsh", ".xdmf": "xdmf"}
"""File endings and meshio's names of the formats that keep both orders, the regions and all fields."""

_UNREADABLE = (
    OSError,
    RuntimeError,
    ImportError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    SyntaxError,
)
"""What meshio's readers raise on a damaged file; it also calls sys.exit."""


def read_mesh(path: str | Path, *, scale: float = 1.0) -> TetMesh:
    """The solid cells of a mesh file as tetrahedra in the accepted form (see `oriented`), with its groups.

    scale: metres per unit of the file, 1e-3 for a file in millimetres. Cells of lower dimension count in
    groups only. Raises MeshError when the file is missing, unreadable, of another format than its ending
    says, holds no solid cells or some that cannot be cut, and where `tetrahedra` and `oriented` do.
    """
    path = Path(path)
    raw = _raw(path)
    tags = next((raw.cell_data[name] for name in TAGS if name in raw.cell_data), None)
    found = [np.zeros(len(b.data)) for b in raw.cells] if tags is None else tags
    regions = [np.asarray(region, int).ravel() for region in found]
    blocks = [
        Block(block.type, np.asarray(block.data), region)
        for block, region in zip(raw.cells, regions, strict=True)
        if _is_solid(block.type)
    ]
    if not blocks:
        held = ", ".join(sorted({block.type for block in raw.cells})) or "no cells"
        raise MeshError(f"{path} holds no tetrahedra, only {held}: export the volume mesh with tetrahedra")
    try:
        mesh = tetrahedra(scale * np.asarray(raw.points, float), blocks)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    untagged = int((mesh.region == 0).sum())
    if tags is not None and 0 < untagged < len(mesh.tets):
        log.warning("%s: %d of %d tetrahedra are in no group: region 0", path, untagged, len(mesh.tets))
    return oriented(replace(mesh, groups=file_groups(raw, mesh)))


def write_mesh(
    path: str | Path,
    mesh: TetMesh,
    *,
    point_data: Mapping[str, np.ndarray | Sequence[float]] | None = None,
    cell_data: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write nodes in metres, tetrahedra and their "region" in the format that the file's ending names.

    point_data: fields (n,) or (n, d) at the nodes; cell_data: fields (m,) or (m, d) in the tetrahedra; units
    as given. Raises MeshError for an ending other than .vtu, .vtk, .msh, .xdmf, a field of the wrong length,
    or a folder that does not exist.
    """
    import meshio

    path = Path(path)
    if path.suffix not in _WRITTEN:
        raise MeshError(f"{path}: meshes are not written as '{path.suffix}': use {', '.join(_WRITTEN)}")
    fields = {"region": mesh.region, **(cell_data or {})}
    _check_fields(point_data or {}, len(mesh.nodes), "nodes")
    _check_fields(fields, len(mesh.tets), "tets")
    if path.suffix == ".msh":
        fields = {**fields, "gmsh:physical": mesh.region, "gmsh:geometrical": mesh.region}
    out = meshio.Mesh(
        mesh.nodes,
        [meshio.CellBlock(_CELLS[mesh.order], mesh.tets)],
        point_data={**(point_data or {})},
        cell_data={name: [values] for name, values in fields.items()},
    )
    try:
        out.write(path, file_format=_WRITTEN[path.suffix])
    except OSError as error:
        raise MeshError(f"{path} cannot be written ({error.strerror}): choose another place") from error


def read_surface(path: str | Path, *, scale: float = 1.0) -> Shell:
    """The closed surface in an STL, OBJ, PLY, OFF or STEP file, equal corners merged, normals out of the
    material.

    scale: metres per unit of the file (STL has no unit; CAD programs mostly write millimetres, 1e-3); a STEP
    file says its unit itself, and scale does not count. Raises
    MeshError when the file is missing or unreadable, and where `softfuse.mesh.shell.checked` does.
    """
    import trimesh

    path = Path(path)
    if not path.is_file():
        raise MeshError(f"there is no file {path}: correct the path")
    check_ending(path)
    if path.suffix.lower() in (".step", ".stp"):
        return read_step(path)
    try:
        raw = trimesh.load_mesh(path, process=False)
    except _UNREADABLE as error:
        raise MeshError(f"{path} cannot be read as a surface ({error}): export it as binary STL") from error
    nodes, faces = getattr(raw, "vertices", np.empty((0, 3))), getattr(raw, "faces", np.empty((0, 3)))
    try:
        return checked(scale * np.asarray(nodes, float), np.asarray(faces))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def write_surface(path: str | Path, shell: Shell, *, scale: float = 1.0) -> None:
    """Write a shell as STL, OBJ, PLY or OFF, by the file's ending.

    scale: units of the file per metre, 1e3 for millimetres. Raises MeshError for another ending.
    """
    import trimesh

    path = Path(path)
    if path.suffix not in (".stl", ".obj", ".ply", ".off"):
        raise MeshError(f"{path}: surfaces are not written as '{path.suffix}': use .stl, .obj, .ply or .off")
    trimesh.Trimesh(scale * shell.nodes, shell.faces, process=False).export(path)


def _check_fields(data: Mapping[str, np.ndarray | Sequence[float]], count: int, place: str) -> None:
    for name, values in data.items():
        if len(values) != count:
            raise MeshError(f"the field '{name}' has {len(values)} values for {count} {place}: give one each")


def _is_solid(kind: str) -> bool:
    from meshio._mesh import topological_dimension

    return kind.startswith("polyhedron") or topological_dimension.get(kind, 3) == 3


def _raw(path: Path):
    """The file as meshio reads it; what meshio prints on the way becomes part of the error."""
    import meshio

    if not path.is_file():
        raise MeshError(f"there is no file {path}: correct the path")
    check_ending(path)
    if path.suffix.lower() == ".inp":
        return read_abaqus(path)
    if is_gmsh_41(path):
        return read_gmsh_41(path)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            return meshio.read(path)
    except (meshio.ReadError, *_UNREADABLE, SystemExit) as error:
        told = " ".join(said.getvalue().split()) or str(error) or type(error).__name__
        raise MeshError(f"{path} cannot be read as a mesh ({told}): export it as VTU or Gmsh 4.1") from error
