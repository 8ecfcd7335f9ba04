"""A mesh whose boundary was only near a surface, brought onto it.

A mesher that works within an envelope cuts corners: a cavity with fillets loses 2 to 4 % of its volume where
edges are as long as its height, and the wall above it is off by the envelope. Each node x of the mesh's
boundary, those in the middle of edges included, goes to the nearest point of the surface that it stands for,
x + s (p(x) − x) with s = 1 except where this would press a tetrahedron flat: there its nodes stay farther
back. Edges are curved afterwards.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from softfuse.mesh.quality import curved_mean_ratios, mean_ratios
from softfuse.mesh.shell import Shell
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import FACES6, TetMesh, quadratic, tet_mesh

_KEPT = 0.3
"""Part of its mean ratio that each tetrahedron keeps, with straight edges and with curved ones."""

_LEAST = 1.0 / 16.0
"""Part of its way below which a node stays where it was."""


def conforming(mesh: TetMesh, shell: Shell, inserts: Sequence[Shell], within: float) -> TetMesh:
    """The mesh with quadratic tetrahedra and its boundary on the shell, its regions' on those of the inserts.

    mesh: valid and with straight edges, its nodes in m. within [m]: nodes that are farther from where they
    belong stay where they are. Numbers and regions of the tetrahedra do not change, nor do those of corners.
    """
    straight = quadratic(mesh)
    outer = np.unique(boundary_faces(straight).faces)
    between = np.setdiff1d(_interface_nodes(straight), outer)
    way = np.zeros_like(straight.nodes)
    for nodes, outlines in ((outer, [shell]), (between, inserts)):
        if len(nodes) and len(outlines):
            way[nodes] = _ways(straight.nodes[nodes], outlines, within)
    return _moved(straight, way)


def _interface_nodes(mesh: TetMesh) -> Int[np.ndarray, " i"]:
    faces = mesh.tets[:, FACES6].reshape(-1, FACES6.shape[1])
    region = np.repeat(mesh.region, len(FACES6))
    order = np.lexsort(np.sort(faces[:, :3], axis=1).T)
    faces, region = faces[order], region[order]
    same = (np.sort(faces[1:, :3], axis=1) == np.sort(faces[:-1, :3], axis=1)).all(axis=1)
    return np.unique(faces[1:][same & (region[1:] != region[:-1])])


def _ways(
    points: Float[np.ndarray, "p 3"], outlines: Sequence[Shell], within: float
) -> Float[np.ndarray, "p 3"]:
    import trimesh

    parts = [trimesh.Trimesh(outline.nodes, outline.faces, process=False) for outline in outlines]
    found = [trimesh.proximity.closest_point(part, points)[:2] for part in parts]
    places, distances = (np.array(each) for each in zip(*found, strict=True))
    nearest, every = np.argmin(distances, axis=0), np.arange(len(points))
    near = distances[nearest, every] <= within
    return np.where(near[:, None], places[nearest, every] - points, 0.0)


def _moved(straight: TetMesh, way: Float[np.ndarray, "n 3"]) -> TetMesh:
    least = _KEPT * mean_ratios(straight)
    part = np.ones((len(way), 1))
    while True:
        moved = tet_mesh(straight.nodes + part * way, straight.tets, region=straight.region)
        flat = np.minimum(mean_ratios(moved), curved_mean_ratios(moved)) < least
        if not flat.any():
            return moved
        held = np.unique(straight.tets[flat])
        part[held] = np.where(part[held] > _LEAST, 0.5 * part[held], 0.0)
