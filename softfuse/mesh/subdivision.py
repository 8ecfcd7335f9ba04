"""Quadratic tetrahedra cut into smaller ones through their nodes.

The nodes in the middle of the edges cut off four corners; the octahedron that is left is cut into four along
one of its three diagonals. Faces are cut into four triangles whichever diagonal that is, so neighbours fit.
"""

import numpy as np

from softfuse.mesh.tetmesh import EDGES, TetMesh, tet_mesh

_CORNERS = [[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3]]
_AROUND = {(4, 9): (5, 6, 7, 8), (5, 7): (4, 8, 9, 6), (6, 8): (4, 5, 9, 7)}
"""Of each diagonal of the octahedron: the other nodes, in turn."""
_ALONG = [[[*ends, ring[k], ring[(k + 1) % 4]] for k in range(4)] for ends, ring in _AROUND.items()]


def subdivided(mesh: TetMesh) -> TetMesh:
    """Linear tetrahedra (24 m) through the nodes of a quadratic mesh: three meshes of 8 m, one on the other.

    Each octahedron is cut along all three diagonals, so that none is favoured and what is symmetric stays so.
    """
    local = np.array(3 * _CORNERS + sum(_ALONG, start=[]))
    return tet_mesh(mesh.nodes, mesh.tets[:, local].reshape(-1, 4), region=np.repeat(mesh.region, len(local)))


def refined(mesh: TetMesh) -> TetMesh:
    """Quadratic tetrahedra (8 m) of half the edges in place of those of a quadratic mesh, curves kept.

    The mesh's nodes come first, all of them corners now.
    """
    local = np.array(_CORNERS + _ALONG[0])
    tets = mesh.tets[:, local].reshape(-1, 4)
    ends = np.sort(tets[:, EDGES], axis=-1).reshape(-1, 2).astype(np.int64)
    _, first, place = np.unique(
        ends[:, 0] * len(mesh.nodes) + ends[:, 1], return_index=True, return_inverse=True
    )
    # Barycentric coordinates of the middles of all children's edges within their parent.
    nodes = np.vstack([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])
    middles = nodes[local][:, EDGES].mean(axis=2).reshape(-1, 4)
    shape = np.hstack([middles * (2.0 * middles - 1.0), 4.0 * middles[:, EDGES].prod(axis=2)])
    parent, which = np.divmod(first, len(middles))
    added = np.einsum("ka,kai->ki", shape[which], mesh.nodes[mesh.tets[parent]])
    return tet_mesh(
        np.vstack([mesh.nodes, added]),
        np.hstack([tets, len(mesh.nodes) + place.reshape(-1, 6)]),
        region=np.repeat(mesh.region, len(local)),
    )
