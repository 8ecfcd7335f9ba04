"""Chambers that are no closed voids of the body's own file: closed surfaces beside it, and open voids.

A surface beside a body of a surface becomes a void of it, unless that has the void already. Beside a body of
a volume mesh it tells which of the mesh's voids is meant, and has to fit it. An open void, such as a chamber
with an inlet, is the part of the skin that reaches from a point inside up to the plane of its mouth; there it
ends in a rim, which a cap closes (softfuse/functional/cavity.py).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from softfuse.errors import MeshError
from softfuse.mesh.overlap import solid
from softfuse.mesh.shell import Shell, checked, shell_parts
from softfuse.mesh.surface import Surface, centroid, enclosed_volume, outer_surface
from softfuse.mesh.tetmesh import TetMesh, edge_lengths

_SAME = 1e-3
"""Part of a chamber's volume by which a void of the body may differ that is the chamber."""

_FIT = 0.25
"""Mean edges of a mesh by which its void may be off a chamber's surface."""

_BEHIND, _ALONG = 0.25, 0.7
"""Mean edges up to which what is behind a mouth's plane, and faces along it (cosine), is skin around it."""


def hollowed(body: Shell, chambers: Sequence[Shell]) -> Shell:
    """The shell of a body with a void for each chamber, closed surfaces inside it in m.

    A void that the body has already stays as it is. Raises MeshError for a chamber that is not all inside the
    material and is no void of the body, or is in several parts.
    """
    voids = [solid(each.nodes, each.faces[:, ::-1]) for each in shell_parts(body) if _volume(each) < 0.0]
    nodes, faces = [body.nodes], [body.faces]
    material = None
    for k, chamber in enumerate(chambers):
        if len(shell_parts(chamber)) != 1:
            raise MeshError(f"the surface of chamber {k} has several parts: give one file for each chamber")
        hole = solid(chamber.nodes, chamber.faces)
        size = hole.volume()
        if any((hole ^ void).volume() > (1 - _SAME) * max(size, void.volume()) for void in voids):
            continue
        material = solid(body.nodes, body.faces) if material is None else material
        common = (hole ^ material).volume()
        if common < (1 - _SAME) * size:
            raise MeshError(
                f"chamber {k} around {_mm(centroid(chamber.nodes, chamber.faces))} mm has "
                f"{1e9 * (size - common):.4g} of its {1e9 * size:.4g} mm³ outside the material: check the "
                "unit and the place of its file; one that is open is cut out of the body, with mouth"
            )
        starts = sum(len(each) for each in nodes)
        nodes.append(chamber.nodes)
        faces.append(chamber.faces[:, ::-1] + starts)
    return checked(np.vstack(nodes), np.vstack(faces))


def check_fit(mesh: TetMesh, wall: Surface, chamber: Shell) -> None:
    """Raise MeshError where a void of a mesh is not what a chamber's surface says."""
    from trimesh import Trimesh
    from trimesh.proximity import closest_point

    nodes = mesh.nodes[np.unique(wall.faces[:, :3])]
    apart = closest_point(Trimesh(chamber.nodes, chamber.faces, process=False), nodes)[1].max()
    allowed = _FIT * float(edge_lengths(mesh).mean())
    if apart > allowed:
        raise MeshError(
            f"the void of {1e9 * enclosed_volume(mesh.nodes, wall.faces):.4g} mm³ that is nearest to a "
            f"chamber's surface of {1e9 * _volume(chamber):.4g} mm³ is up to {1e3 * apart:.3g} mm off it, "
            f"{1e3 * allowed:.3g} mm are allowed: check the unit of its file and the centre"
        )


def open_void(
    mesh: TetMesh,
    inside: Float[np.ndarray, "3"],
    mouth: Float[np.ndarray, "3"],
    outwards: Float[np.ndarray, "3"],
) -> Surface:
    """The walls of the open void around a point inside (3,) m, with normals out of it into the material.

    mouth (3,) m: a point in its opening; outwards (3,) of any length: across the opening, out of the body.
    Raises MeshError when no wall is seen from the point, or the walls do not end in one rim.
    """
    skin = outer_surface(mesh)
    corners = mesh.nodes[skin.faces[:, :3]]
    normal = np.asarray(outwards, float) / np.linalg.norm(outwards)
    edge = float(edge_lengths(mesh).mean())
    # On the inner side of the mouth's plane, but not the skin around the mouth: a mesher leaves that in the
    # plane no better than within a small part of an edge.
    depth, facing = (mouth - corners.mean(axis=1)) @ normal, _normals(corners) @ normal
    before = (depth > 1e-3 * edge) & ((depth > _BEHIND * edge) | (facing < _ALONG))
    label = _connected(skin, before)
    nearest = _seen_from(np.asarray(inside, float), corners)
    part = -1 if nearest is None else label[nearest]
    if part < 0:
        raise MeshError(
            f"no wall of an open void is seen from {_mm(inside)} mm behind its mouth at {_mm(mouth)} mm: "
            "give a centre inside the void and turn outwards out of the body"
        )
    walls = Surface(skin.faces[label == part], skin.tets[label == part]).turned()
    rims = _rims(walls)
    if len(rims) != 1:
        places = "; ".join(_mm(mesh.nodes[rim].mean(axis=0)) for rim in rims[:4]) or "none"
        raise MeshError(
            f"the void around {_mm(inside)} mm opens at {len(rims)} places (in mm: {places}): it needs one "
            "mouth, in whose plane the body's skin does not come back"
        )
    return walls


def _connected(skin: Surface, kept: np.ndarray) -> np.ndarray:
    """Number of the part that each face is in, by kept faces that share an edge; -1 for the others."""
    faces = np.flatnonzero(kept)
    edges = np.sort(skin.faces[faces][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, place = np.unique(edges, axis=0, return_inverse=True)
    order = np.argsort(place, kind="stable")
    same = np.flatnonzero(np.diff(np.ravel(place)[order]) == 0)
    ends = order[same] // 3, order[same + 1] // 3
    graph = coo_array((np.ones(len(same)), ends), shape=(len(faces), len(faces)))
    label = np.full(len(skin.faces), -1)
    label[faces] = connected_components(graph, directed=False)[1]
    return label


def _seen_from(point: np.ndarray, corners: np.ndarray) -> int | None:
    """The nearest face whose normal, out of the material, looks towards the point; None without any."""
    middle = corners.mean(axis=1)
    towards = np.einsum("fi,fi->f", _normals(corners), point - middle) > 0.0
    far = np.where(towards, np.linalg.norm(middle - point, axis=1), np.inf)
    return int(np.argmin(far)) if towards.any() else None


def _normals(corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 3"]:
    """Of length 1, out of the material."""
    a, b, c = (corners[:, k] for k in range(3))
    across = np.cross(b - a, c - a)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def _rims(walls: Surface) -> list[np.ndarray]:
    """Corners of each closed line in which walls end."""
    edges = np.sort(walls.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    ends = unique[count == 1]
    if not len(ends):
        return []
    used, place = np.unique(ends, return_inverse=True)
    graph = coo_array((np.ones(len(ends)), tuple(place.reshape(-1, 2).T)), shape=(len(used), len(used)))
    n, label = connected_components(graph, directed=False)
    return [used[label == k] for k in range(n)]


def _volume(shell: Shell) -> float:
    return enclosed_volume(shell.nodes, shell.faces)


def _mm(place: np.ndarray) -> str:
    return f"{(1e3 * np.asarray(place)).round(2).tolist()}"
