"""Meshes brought to the one accepted form, or refused with the place and the remedy.

Accepted: finite coordinates, no two nodes at one place, every node used, corners before mid-edge nodes,
positive volumes, every face in one or two tetrahedra. Two positive tetrahedra on opposite sides of their
common face list its corners in opposite senses; the same sense means that both lie on the same side, hence
overlap: such a mesh is folded, and exchanging nodes would only hide it.
"""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Int

from softfuse.errors import MeshError
from softfuse.mesh.tetmesh import FACES, TetMesh, edge_lengths, nodal_jacobians, tet_mesh, volumes

log = logging.getLogger(__name__)

_FLAT = 1e-6
"""Smallest volume over the cube of the longest edge that is not degenerate; 0.118 when regular."""

_SWAP = np.array([0, 2, 1, 3, 6, 5, 4, 7, 9, 8])
"""Exchange of the corners 1 and 2, mid-edge nodes included."""


def oriented(mesh: TetMesh) -> TetMesh:
    """The mesh in the accepted form: unused nodes dropped, corners first, all volumes positive.

    Tetrahedra of negative volume get two nodes exchanged, which mends a file of the other convention. Raises
    MeshError where that does not help: what `check` refuses.
    """
    _check_arrays(mesh)
    mesh = _corners_first(mesh)
    _check_volumes(mesh)
    negative = volumes(mesh) < 0.0
    if negative.any():
        log.info("flipped %d of %d tets, whose volume was negative", negative.sum(), len(negative))
        tets = np.where(negative[:, None], mesh.tets[:, _SWAP[: mesh.tets.shape[1]]], mesh.tets)
        mesh = replace(mesh, tets=tets)
    check(mesh)
    return mesh


def check(mesh: TetMesh) -> None:
    """Raise MeshError, with place and remedy, unless the mesh is in the accepted form."""
    _check_arrays(mesh)
    _check_nodes(mesh)
    _check_volumes(mesh)
    size = volumes(mesh)
    if (size < 0.0).any():
        worst = int(np.argmin(size))
        raise MeshError(
            f"tet {worst} has volume {size[worst]:.3g} m³: flip its nodes (`oriented` does) or remesh"
        )
    _check_faces(mesh)
    _check_curved(mesh)


def _check_arrays(mesh: TetMesh) -> None:
    nodes, tets = mesh.nodes, mesh.tets
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise MeshError(f"nodes have the shape {nodes.shape}: a mesh needs (n, 3) coordinates in metres")
    if tets.ndim != 2 or tets.shape[1] not in (4, 10):
        raise MeshError(f"tets have the shape {tets.shape}: give (m, 4) or (m, 10) node numbers")
    if len(tets) == 0:
        raise MeshError("the mesh holds no tetrahedra: export the volume mesh, not only its surface")
    if mesh.region.shape != (len(tets),):
        raise MeshError(f"region has the shape {mesh.region.shape}: give one number per tet, {len(tets)}")
    bad = ~np.isfinite(nodes).all(axis=1)
    if bad.any():
        node = int(np.argmax(bad))
        raise MeshError(f"node {node} has the position {nodes[node]}: it must be finite; export it again")
    bad = ((tets < 0) | (tets >= len(nodes))).any(axis=1)
    if bad.any():
        tet = int(np.argmax(bad))
        raise MeshError(f"tet {tet} names nodes {tets[tet].tolist()}; they run from 0 to {len(nodes) - 1}")


def _check_nodes(mesh: TetMesh) -> None:
    used = np.zeros(len(mesh.nodes), bool)
    used[mesh.tets] = True
    if not used.all():
        raise MeshError(f"no tet uses node {int(np.argmin(used))}: drop such nodes (`oriented` does)")
    corner = np.zeros(len(mesh.nodes), bool)
    corner[mesh.corners] = True
    corner[mesh.tets[:, 4:]] = False
    if corner.sum() != mesh.n_corners:
        raise MeshError("corner and mid-edge nodes are mixed: number the corners first (`oriented` does)")
    extent = np.ptp(mesh.nodes, axis=0).max()
    order = np.lexsort(np.round(mesh.nodes / (1e-9 * extent)).T)
    same = (np.abs(np.diff(mesh.nodes[order], axis=0)) < 1e-9 * extent).all(axis=1)
    if same.any():
        first = int(np.argmax(same))
        a, b = sorted(order[first : first + 2].tolist())
        raise MeshError(f"nodes {a} and {b} are at the same place {mesh.nodes[a]} m: merge duplicate nodes")


def _check_volumes(mesh: TetMesh) -> None:
    size, length = volumes(mesh), edge_lengths(mesh).max(axis=1)
    shape = np.abs(size) / np.maximum(length, np.finfo(float).tiny) ** 3
    worst = int(np.argmin(shape))
    if shape[worst] < _FLAT:
        raise MeshError(
            f"tet {worst} is flat: volume {size[worst]:.3g} m³ at edges of {length[worst]:.3g} m: remesh"
        )


def _check_faces(mesh: TetMesh) -> None:
    faces = mesh.corners[:, FACES].reshape(-1, 3)
    key = np.sort(faces, axis=1)
    order = np.lexsort(key.T[::-1])
    same = (np.diff(key[order], axis=0) == 0).all(axis=1)
    three = same[1:] & same[:-1]
    if three.any():
        at = int(np.argmax(three))
        raise MeshError(
            f"the face {key[order[at]].tolist()} belongs to the tets {(order[at : at + 3] // 4).tolist()}: "
            "at most two may share a face; remove duplicates or remesh"
        )
    first, second = faces[order[:-1]][same], faces[order[1:]][same]
    folded = _cyclic(first) == _cyclic(second)
    if folded.any():
        at = int(np.flatnonzero(same)[np.argmax(folded)])
        a, b = (order[at : at + 2] // 4).tolist()
        size = volumes(mesh)
        raise MeshError(
            f"tets {a} and {b} (volumes {size[a]:.3g} and {size[b]:.3g} m³) overlap: both lie on the same "
            "side of their common face, so one of them is inverted; move its nodes back or remesh"
        )


def _cyclic(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " f"]:
    """Sense (f,) of the corners: ±1, alike for the three rotations of a face."""
    a, b, c = faces.T
    return np.where((a < b).astype(int) + (b < c) + (c < a) == 2, 1, -1)


def _check_curved(mesh: TetMesh) -> None:
    if mesh.order == 1:
        return
    lowest = nodal_jacobians(mesh).min(axis=1)
    bad = lowest <= 0.0
    if bad.any():
        tet = int(np.argmax(bad))
        raise MeshError(
            f"curved tet {tet} is inverted at one of its nodes (Jacobian {lowest[tet]:.3g} m³): "
            "straighten its edges or remesh finer"
        )


def _corners_first(mesh: TetMesh) -> TetMesh:
    corner = np.unique(mesh.corners)
    middle = np.setdiff1d(np.unique(mesh.tets[:, 4:]), corner)
    keep = np.concatenate([corner, middle])
    if len(keep) < len(mesh.nodes):
        log.info("dropped %d nodes that no tetrahedron uses", len(mesh.nodes) - len(keep))
    number = np.full(len(mesh.nodes), -1, np.int32)
    number[keep] = np.arange(len(keep))
    pairs = {name: number[of] for name, of in mesh.groups.items()}
    groups = {name: of[((of >= 0) & (of < len(corner))).all(axis=1)] for name, of in pairs.items()}
    return replace(tet_mesh(mesh.nodes[keep], number[mesh.tets], region=mesh.region), groups=groups)
