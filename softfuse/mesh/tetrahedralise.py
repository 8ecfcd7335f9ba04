"""A closed surface filled with tetrahedra by fTetWild, through pytetwild.

fTetWild meshes the bounding box so that the given surfaces stay within an envelope of their place, and keeps
the tetrahedra whose winding number is above 1/2: cavities, wound the other way, stay empty. Outlines of stiff
inserts are given to it together with the body's, so that faces of the mesh lie near them. Then the nodes are
brought onto the surfaces, see `conforming`. The same input gives the same mesh on one machine (`kept_fill`).

Facets that are narrower than the edges asked for would make the mesh as fine as they are, unless the envelope
has room for edges across several of them: of a circle of radius r an edge ℓ cuts off ℓ²/8r. It is a twentieth
of the edge length where nobody says otherwise; what is cut off there is made up for by curved edges.

Source: Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast tetrahedral meshing in the wild", ACM Trans.
Graph. 39(4), 2020, DOI 10.1145/3386569.3392385.
"""

import contextlib
import logging
import tempfile
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from softfuse.errors import MeshError
from softfuse.mesh.conforming import conforming
from softfuse.mesh.kept_fill import Fill, kept_fill
from softfuse.mesh.orientation import oriented
from softfuse.mesh.shell import Shell, shell_area, shell_parts
from softfuse.mesh.surface import boundary_components, enclosed_volume, winding_number
from softfuse.mesh.tetmesh import TetMesh, edge_lengths, tet_mesh, volumes

log = logging.getLogger(__name__)

_REACH = 2.0
"""Envelopes within which a node is brought onto a surface."""

_ENVELOPE, _LEAST_ENVELOPE = 1 / 20, 1e-3
"""Envelope over the edge length, and its least size over the diagonal."""

_SHORT = 0.35
"""Mean edge over the edge length asked for below which it is said that the mesh is finer."""


def tetrahedralise(
    shell: Shell, edge_length: float, *, inserts: Sequence[Shell] = (), envelope: float | None = None
) -> TetMesh:
    """Quadratic tetrahedra of the body inside a shell, with edges of edge_length m or less that follow it.

    inserts: shells inside the material; the tetrahedra in inserts[k] get the region k + 1, all others 0 (the
    last one wins where inserts overlap). envelope: how far faces with straight edges may be from the shell,
    over the diagonal of the bounding box; the larger, the fewer tetrahedra at fillets; None: a twentieth of
    edge_length, but at least 1e-3. Raises MeshError when edge_length is out of range, or the mesh misses a
    cavity or differs in volume by more than the envelope allows.
    """
    diagonal = float(np.linalg.norm(np.ptp(shell.nodes, axis=0)))
    if not 1e-3 * diagonal <= edge_length <= diagonal:
        raise MeshError(
            f"the edge length {1e3 * edge_length:.4g} mm does not suit a body of {1e3 * diagonal:.4g} mm: "
            f"choose {1e3 * diagonal / 40:.3g} to {1e3 * diagonal / 10:.3g} mm, and check its unit"
        )
    if envelope is None:
        envelope = max(_ENVELOPE * edge_length / diagonal, _LEAST_ENVELOPE)
    mesh = oriented(tet_mesh(*_filled([shell, *inserts], edge_length, envelope)))
    _check_filled(mesh, shell, envelope * diagonal)
    mean = float(edge_lengths(mesh).mean())
    if mean < _SHORT * edge_length:
        log.warning(
            "the edges are %.3g mm on average, not %.3g mm: walls or facets of the surface are finer than "
            "that; coarser facets or a larger envelope than %.2g give fewer tetrahedra",
            *(1e3 * mean, 1e3 * edge_length, envelope),
        )
    mesh = tet_mesh(mesh.nodes, mesh.tets, region=insert_regions(mesh, inserts))
    return conforming(mesh, shell, inserts, _REACH * envelope * diagonal)


def _filled(outlines: Sequence[Shell], edge_length: float, envelope: float) -> Fill:
    starts = np.cumsum([0, *(len(part.nodes) for part in outlines[:-1])])
    nodes = np.vstack([part.nodes for part in outlines])
    shifted = [part.faces + start for part, start in zip(outlines, starts, strict=True)]
    faces = np.vstack(shifted).astype(np.int32)

    def fill() -> Fill:
        from pytetwild.pytetwild import tetrahedralize

        # fTetWild leaves a file __tracked_surface.stl in the working directory.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            return tetrahedralize(
                nodes, faces, edge_length_abs=edge_length, epsilon=envelope, vtk_ordering=True, quiet=True
            )

    return kept_fill(fill, nodes, faces, edge_length, envelope)


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
            f"the mesh fills {1e9 * made:.6g} mm³ of the {1e9 * given:.6g} mm³ inside the surface: a part of "
            "it may cross itself; repair it, or ask for shorter edges or a smaller envelope"
        )
    wanted, found = len(shell_parts(shell)), len(boundary_components(mesh))
    if wanted != found:
        raise MeshError(
            f"the surface has {wanted} closed parts, its mesh {found}: ask for shorter edges or a smaller "
            "envelope"
        )
