"""A mesh whose boundary was only near a surface, brought onto it.

A mesher that works within an envelope cuts corners: a cavity with fillets loses 2 to 4 % of its volume where
edges are as long as its height, and the wall above it is off by the envelope. Each node x of the mesh's
boundary, those in the middle of edges included, goes to the nearest point p(x) of the surface that it stands
for, which curves the edges; where this would press a tetrahedron flat its nodes stay farther back.

Faces across a fillet that is narrower than they are still cut it off. What a small change δ of a wall does to
the body is ∫ δ g dA with a g as smooth as stresses are, so walls of cavities are not left where their nodes
are right but moved by the u = Σ N_a u_a for which the mean with each shape function is,

    ∫ N_a (p(x) − x − u) dA = 0,

the projection in L² of what is missing, a few times. The skin keeps its nodes on the surface: held ones and
contacts are looked for there.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from softfuse.mesh.quality import curved_mean_ratios, mean_ratios
from softfuse.mesh.shell import Shell
from softfuse.mesh.surface import boundary_faces, cavities
from softfuse.mesh.tetmesh import FACES6, TetMesh, quadratic

if TYPE_CHECKING:
    import trimesh

KEPT = 0.3
"""Part of its mean ratio that each tetrahedron keeps, with straight edges and with curved ones."""

_LEAST = 1.0 / 16.0
"""Part of its way below which a node stays where it was."""

_ROUNDS = 4
"""Times that walls are moved by what is missing: nearest points tell two thirds of it across an edge."""


def _lattice() -> Float[np.ndarray, "q 6"]:
    """Shape functions of a face's six nodes at the middles of the sixteen equal triangles of its area."""
    corners = np.array([[i, j] for i in range(4) for j in range(4 - i)])
    up, down = (3 * corners + 1) / 12, (3 * corners[corners.sum(axis=1) < 3] + 2) / 12
    first = np.vstack([up, down])
    at = np.column_stack([1.0 - first.sum(axis=1), first])
    return np.hstack([at * (2.0 * at - 1.0), 4.0 * at * np.roll(at, -1, axis=1)])


_SHAPE = _lattice()


def conforming(mesh: TetMesh, shell: Shell, inserts: Sequence[Shell], within: float) -> TetMesh:
    """The mesh with quadratic tetrahedra and its boundary on the shell, its regions' on those of the inserts.

    mesh: valid and with straight edges, its nodes in m. within [m]: what is farther from where it belongs
    stays where it is. Numbers and regions of the tetrahedra do not change, nor do those of corners. Raises
    MeshError when the mesh falls into several parts.
    """
    straight = quadratic(mesh)
    least = KEPT * mean_ratios(straight)
    walls = cavities(straight)
    outer = np.unique(boundary_faces(straight).faces)
    between = np.setdiff1d(_interface_nodes(straight), outer)
    way = np.zeros_like(straight.nodes)
    skin = _triangles([shell])
    for nodes, triangles in ((outer, skin), (between, _triangles(inserts))):
        if len(nodes) and triangles:
            way[nodes] = _ways(straight.nodes[nodes], triangles, within)
    found = moved_within(straight, way, least)
    for _ in range(_ROUNDS if walls else 0):
        found = moved_within(
            found, _missing(found, np.vstack([wall.faces for wall in walls]), skin, within), least
        )
    return found


def _interface_nodes(mesh: TetMesh) -> Int[np.ndarray, " i"]:
    faces = mesh.tets[:, FACES6].reshape(-1, FACES6.shape[1])
    region = np.repeat(mesh.region, len(FACES6))
    order = np.lexsort(np.sort(faces[:, :3], axis=1).T)
    faces, region = faces[order], region[order]
    same = (np.sort(faces[1:, :3], axis=1) == np.sort(faces[:-1, :3], axis=1)).all(axis=1)
    return np.unique(faces[1:][same & (region[1:] != region[:-1])])


def _triangles(outlines: Sequence[Shell]) -> "list[trimesh.Trimesh]":
    import trimesh

    # They keep the tree in which the nearest triangle is looked for.
    return [trimesh.Trimesh(outline.nodes, outline.faces, process=False) for outline in outlines]


def _ways(
    points: Float[np.ndarray, "p 3"], triangles: "Sequence[trimesh.Trimesh]", within: float
) -> Float[np.ndarray, "p 3"]:
    from trimesh.proximity import closest_point

    found = [closest_point(part, points)[:2] for part in triangles]
    places, distances = (np.array(each) for each in zip(*found, strict=True))
    nearest, every = np.argmin(distances, axis=0), np.arange(len(points))
    near = distances[nearest, every] <= within
    return np.where(near[:, None], places[nearest, every] - points, 0.0)


def _missing(
    mesh: TetMesh, faces: Int[np.ndarray, "f 6"], triangles: "Sequence[trimesh.Trimesh]", within: float
) -> Float[np.ndarray, "n 3"]:
    a, b, c = (mesh.nodes[faces[:, k]] for k in range(3))
    weight = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    points = np.einsum("qa,fai->fqi", _SHAPE, mesh.nodes[faces])
    ways = _ways(points.reshape(-1, 3), triangles, within).reshape(points.shape)
    used, place = np.unique(faces, return_inverse=True)
    place = place.reshape(faces.shape)
    rows, columns = np.broadcast_arrays(place[:, :, None], place[:, None, :])
    products = weight[:, None, None] * (_SHAPE.T @ _SHAPE)
    matrix = csc_array((products.ravel(), (rows.ravel(), columns.ravel())), shape=(len(used), len(used)))
    right = np.zeros((len(used), 3))
    np.add.at(right, place, weight[:, None, None] * np.einsum("qa,fqi->fai", _SHAPE, ways))
    result = np.zeros_like(mesh.nodes)
    result[used] = splu(matrix).solve(right)
    return result


def moved_within(mesh: TetMesh, way: Float[np.ndarray, "n 3"], least: Float[np.ndarray, " m"]) -> TetMesh:
    """The quadratic mesh with its nodes moved by a way (n, 3) m, less far or not at all where that would take
    a tetrahedron's mean ratio, straight or curved, below its `least` (m,).
    """
    part = np.ones((len(way), 1))
    while True:
        moved = replace(mesh, nodes=mesh.nodes + part * way)
        flat = np.minimum(mean_ratios(moved), curved_mean_ratios(moved)) < least
        if not flat.any():
            return moved
        held = np.unique(mesh.tets[flat])
        part[held] = np.where(part[held] > _LEAST, 0.5 * part[held], 0.0)
