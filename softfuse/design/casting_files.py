"""Solids as STL files in millimetres, for printers and CAD programs.

STL is a list of triangles, in single precision and without a unit; slicers take it for millimetres. Slicers
print it as it is. A CAD program imports it as a mesh of facets: it can be measured, cut and joined with
other meshes, but has no faces or fillets to change, and turned into a solid it stays faceted; what is to be
changed is changed in the layout and written again. STEP has true faces, but a writer of it needs a CAD kernel
of some hundred megabytes, and 3MF would only add the unit.

Corners closer than 0.1 µm are joined before a file is written, so that they stay apart in single precision,
and the triangles are sorted: the same solids make the same bytes.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softfuse.design.casting import Casting
from softfuse.design.mould import Mould
from softfuse.errors import MeshError, SoftfuseError
from softfuse.mesh.files import write_surface
from softfuse.mesh.shell import Shell

if TYPE_CHECKING:
    from manifold3d import Manifold

RESOLUTION = 1e-7
"""Distance in m below which corners are one in a file; single precision tells a tenth of it at 100 mm."""

_VOLUME = 1e-5
"""Part of its volume by which what is read back may differ."""

_MM = 1e3
"""Millimetres in a metre."""


def named_solids(casting: Casting, mould: Mould | None = None) -> dict[str, "Manifold"]:
    """The solids [m] under the names of their files: "body", "body_with_ports", "core_<name>" for each
    cavity, and "mould_lower" and "mould_upper" with a mould.

    What is not a letter, a digit, "-" or "_" in a cavity's name becomes "-". Raises SoftfuseError where two
    names become one.
    """
    solids = {"body": casting.body, "body_with_ports": casting.body_with_ports}
    for name, core in zip(casting.names, casting.cores, strict=True):
        file = f"core_{re.sub(r'[^A-Za-z0-9_-]', '-', name)}"
        if file.lower() in {other.lower() for other in solids}:
            raise SoftfuseError(f"two cavities would both be written as {file}.stl: rename {name!r}")
        solids[file] = core
    if mould is not None:
        solids |= {"mould_lower": mould.lower, "mould_upper": mould.upper}
    return solids


def write_casting(folder: str | Path, casting: Casting, mould: Mould | None = None) -> tuple[Path, ...]:
    """Write each of `named_solids` as binary STL in mm into a folder, which is made, and read it back.

    Returns the files. Raises MeshError where a file cannot be written, or is not the solid when read back.
    """
    folder = Path(folder)
    written = []
    for name, solid in named_solids(casting, mould).items():
        path = folder / f"{name}.stl"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_surface(path, solid_shell(solid), scale=_MM)
        except OSError as error:
            raise MeshError(f"{path} cannot be written ({error.strerror}): choose another place") from error
        volume = read_solid(path).volume()
        if abs(volume - solid.volume()) > _VOLUME * solid.volume():
            raise MeshError(
                f"{path} holds {1e9 * volume:.6g} mm³, the solid {1e9 * solid.volume():.6g} mm³: give a "
                "larger chord, or walls that are farther from touching"
            )
        written.append(path)
    return tuple(written)


def read_solid(path: str | Path) -> "Manifold":
    """The solid [m] in an STL file in mm.

    Raises MeshError where its triangles, equal corners joined, do not close it.
    """
    import trimesh
    from manifold3d import Error, Manifold, Mesh64

    raw = trimesh.load_mesh(path, process=False)
    corners, faces = np.unique(np.asarray(raw.triangles).reshape(-1, 3), axis=0, return_inverse=True)
    solid = Manifold(Mesh64(corners / _MM, faces.reshape(-1, 3).astype(np.uint64)))
    if solid.status() != Error.NoError or solid.is_empty():
        raise MeshError(
            f"the triangles of {path} do not close a solid ({solid.status().name}): give a larger chord, or "
            "walls that are farther from touching"
        )
    return solid


def solid_shell(solid: "Manifold") -> Shell:
    """The surface of a solid [m] as it is written: rounded to single precision in mm, in a fixed order."""
    mesh = solid.simplify(RESOLUTION).to_mesh64()
    corners = np.asarray(mesh.vert_properties)[:, :3]
    rounded = (_MM * corners).astype(np.float32).astype(float) / _MM
    order = np.lexsort(rounded.T[::-1])
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    faces = place[np.asarray(mesh.tri_verts, np.int64)]
    # Each triangle from its lowest corner on, which keeps its sense.
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return Shell(rounded[order], faces[np.lexsort(faces.T[::-1])])
