"""A closed surface filled with tetrahedra by fTetWild, through pytetwild.

fTetWild meshes the bounding box so that the given surfaces stay within an envelope of their place, and keeps
the tetrahedra whose winding number is above 1/2: cavities, wound the other way, stay empty. Outlines of stiff
inserts are given to it together with the body's, so that faces of the mesh lie near them. Then the nodes are
brought onto the surfaces, see `conforming`. The result differs slightly from run to run: write the mesh to a
file where it has to be the same again.

Source: Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast tetrahedral meshing in the wild", ACM Trans.
Graph. 39(4), 2020, DOI 10.1145/3386569.3392385.
"""

import contextlib
import tempfile
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from softfuse.errors import MeshError
from softfuse.mesh.conforming import conforming
from softfuse.mesh.orientation import oriented
from softfuse.mesh.shell import Shell, shell_area, shell_parts
from softfuse.mesh.surface import boundary_components, enclosed_volume, winding_number
from softfuse.mesh.tetmesh import TetMesh, tet_mesh, volumes

_REACH = 2.0
"""Envelopes within which a node is brought onto a surface."""


def tetrahedralise(
    shell: Shell, edge_length: float, *, inserts: Sequence[Shell] = (), envelope: float = 1e-3
) -> TetMesh:
    """Quadratic tetrahedra of the body inside a shell, with edges of edge_length m or less that follow it.

    inserts: shells inside the material; the tetrahedra in inserts[k] get the region k + 1, all others 0 (the
    last one wins where inserts overlap). envelope: how far faces with straight edges may be from the shell,
    over the diagonal of the bounding box; the larger, the fewer tetrahedra at fillets. Raises MeshError when
    edge_length is out of range, or the mesh misses a cavity or differs in volume by more than the envelope
    allows.
    """
    from pytetwild.pytetwild import tetrahedralize

    diagonal = float(np.linalg.norm(np.ptp(shell.nodes, axis=0)))
    if not 1e-3 * diagonal <= edge_length <= diagonal:
        raise MeshError(
            f"the edge length {1e3 * edge_length:.4g} mm does not suit a body of {1e3 * diagonal:.4g} mm: "
            f"choose {1e3 * diagonal / 40:.3g} to {1e3 * diagonal / 10:.3g} mm, and check its unit"
        )
    outlines = [shell, *inserts]
    starts = np.cumsum([0, *(len(part.nodes) for part in outlines[:-1])])
    faces = [part.faces + start for part, start in zip(outlines, starts, strict=True)]
    # fTetWild leaves a file __tracked_surface.stl in the working directory.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        nodes, tets = tetrahedralize(
            np.vstack([part.nodes for part in outlines]),
            np.vstack(faces).astype(np.int32),
            edge_length_abs=edge_length,
            epsilon=envelope,
            vtk_ordering=True,
            quiet=True,
        )
    mesh = oriented(tet_mesh(nodes, tets))
    _check_filled(mesh, shell, envelope * diagonal)
    mesh = tet_mesh(mesh.nodes, mesh.tets, region=insert_regions(mesh, inserts))
    return conforming(mesh, shell, inserts, _REACH * envelope * diagonal)


def insert_regions(mesh: TetMesh, inserts: Sequence[Shell]) -> Int[np.ndarray, " m"]:
    """Region (m,) of each tetrahedron: k + 1 when its centroid is inside inserts[k], else 0.

    Raises MeshError for an insert that holds no centroid.
    """
    centroids: Float[np.ndarray, "m 3"] = mesh.nodes[mesh.corners].mean(axis=1)
    region = np.zeros(len(mesh.tets), np.int32)
    for k, insert in enumerate(inserts):
        inside = winding_number(centroids, insert.nodes, insert.faces) > 0.5
        if not inside.any():
            middle = (1e3 * insert.nodes.mean(axis=0)).round(2)
            raise MeshError(
                f"insert {k} around {middle} mm holds no tetrahedron: check that it lies in the body and has "
                "the same unit, or mesh finer"
            )
        region[inside] = k + 1
    return region


def _check_filled(mesh: TetMesh, shell: Shell, distance: float) -> None:
    given, made = enclosed_volume(shell.nodes, shell.faces), float(volumes(mesh).sum())
    if abs(made - given) > shell_area(shell) * distance:
        raise MeshError(
            f"the mesh fills {1e9 * made:.6g} mm³ of the {1e9 * given:.6g} mm³ inside the surface: this may "
            "cross itself; repair it, or ask for shorter edges or a smaller envelope"
        )
    wanted, found = len(shell_parts(shell)), len(boundary_components(mesh))
    if wanted != found:
        raise MeshError(
            f"the surface has {wanted} closed parts, its mesh {found}: ask for shorter edges or a smaller "
            "envelope"
        )
