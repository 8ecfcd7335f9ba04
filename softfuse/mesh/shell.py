"""Closed triangle surfaces (STL, OBJ, PLY) as outlines of a body, its cavities and its inserts.

A shell is closed when each edge belongs to two triangles, and consistently wound when these pass it in
opposite directions. Connected parts may lie inside each other: the outermost has its normals outwards, a part
inside one other is a cavity and has them inwards (out of the material), and so on by depth; the winding
number of all parts together is then 1 in the material and 0 elsewhere. Files differ in how they wind
cavities, so `checked` winds them by depth. Parts that cross or touch are united first (`overlap`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from softfuse.errors import MeshError
from softfuse.mesh.overlap import nested_parts, united
from softfuse.mesh.surface import boundary_faces, enclosed_volume
from softfuse.mesh.tetmesh import TetMesh

_MERGE = 1e-6
"""Corners closer than this fraction of the extent are one: STL repeats each corner, in single precision."""


@dataclass(frozen=True, eq=False)
class Shell:
    """Nodes (n, 3) in metres and triangles (f, 3), counter-clockwise seen from outside the material."""

    nodes: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]


def checked(nodes: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Shell:
    """A shell from triangles in m: equal corners merged, closed, normals out of the material.

    Raises MeshError when the surface is empty, not finite, has open edges, edges of more than two triangles,
    is wound inconsistently, or a part of it encloses no volume; and as `nested_parts` does.
    """
    nodes, faces = _merged(np.asarray(nodes, float), np.asarray(faces, np.int64))
    _check_closed(nodes, faces)
    turned = faces.copy()
    parts = _parts(faces)
    volume = [enclosed_volume(nodes, faces[part]) for part in parts]
    for k, part in enumerate(parts):
        extent = np.ptp(nodes[faces[part]].reshape(-1, 3), axis=0).max()
        if abs(volume[k]) < 1e-9 * extent**3:
            raise MeshError(f"part {k} of the surface at {nodes[faces[part][0, 0]]} m is flat: remove it")
    inside, groups = nested_parts(nodes, [faces[part] for part in parts], volume)
    if groups:
        return checked(*united(nodes, [faces[part] for part in parts], volume, groups))
    for k, part in enumerate(parts):
        if (volume[k] > 0.0) != (inside[k].sum() % 2 == 0):
            turned[part] = faces[part][:, ::-1]
    return Shell(nodes, turned.astype(np.int32))


def shell_of(mesh: TetMesh) -> Shell:
    """The whole boundary of a mesh as flat triangles of its corners, cavities included."""
    faces = boundary_faces(mesh).faces[:, :3]
    used, place = np.unique(faces, return_inverse=True)
    return Shell(mesh.nodes[used], place.reshape(-1, 3).astype(np.int32))


def shell_parts(shell: Shell) -> list[Shell]:
    """The connected closed parts of a shell."""
    return [Shell(shell.nodes, shell.faces[part]) for part in _parts(shell.faces)]


def shell_area(shell: Shell) -> float:
    """Area in m² of all triangles."""
    a, b, c = (shell.nodes[shell.faces[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _merged(nodes: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(faces) == 0:
        raise MeshError("the surface holds no triangles: export the outline of the body as triangles")
    bad = ~np.isfinite(nodes).all(axis=1)
    if bad.any():
        at = int(np.argmax(bad))
        raise MeshError(f"corner {at} of the surface has the position {nodes[at]}, not finite: repair it")
    grain = _MERGE * np.ptp(nodes, axis=0).max()
    if grain == 0.0:
        raise MeshError("all corners of the surface are at one place: export it again")
    _, first, place = np.unique(np.round(nodes / grain), axis=0, return_index=True, return_inverse=True)
    faces = np.ravel(place)[faces]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    used, number = np.unique(faces[~flat], return_inverse=True)
    return nodes[first[used]], number.reshape(-1, 3)


def _check_closed(nodes: np.ndarray, faces: np.ndarray) -> None:
    ways = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges, place, count = np.unique(np.sort(ways, axis=1), axis=0, return_inverse=True, return_counts=True)

    def where(wrong: np.ndarray) -> str:
        return f"{(1e3 * nodes[edges[np.argmax(wrong)]].mean(axis=0)).round(3)} mm"

    if (open_ := count == 1).any():
        raise MeshError(
            f"the surface is not watertight: {open_.sum()} open edges, the first near {where(open_)}; "
            "close the hole in the CAD program or with a mesh repair tool and export it again"
        )
    if (many := count > 2).any():
        raise MeshError(
            f"{many.sum()} edges of the surface belong to more than two triangles, the first near "
            f"{where(many)}: remove doubled triangles and separate the parts that touch there"
        )
    forward = np.bincount(np.ravel(place), weights=ways[:, 0] < ways[:, 1])
    if (wrong := forward != 1).any():
        raise MeshError(
            f"the triangles are wound inconsistently at {wrong.sum()} edges, the first near {where(wrong)}: "
            "unify the normals in the CAD program and export it again"
        )


def _parts(faces: np.ndarray) -> list[np.ndarray]:
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owners = (np.lexsort(edges.T) // 3).reshape(-1, 2)
    graph = coo_array((np.ones(len(owners)), (owners[:, 0], owners[:, 1])), shape=(len(faces), len(faces)))
    count, label = connected_components(graph, directed=False)
    return [np.flatnonzero(label == k) for k in range(count)]
