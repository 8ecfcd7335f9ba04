"""Closed surfaces of a tetrahedral mesh: its outer skin and its cavities.

The boundary is the set of faces of one tetrahedron only, oriented outwards from the material. The volume
inside a closed surface of flat triangles (a, b, c) is V = Σ a · (b × c) / 6 (divergence theorem), positive
when the normals point out of the enclosed space. With normals out of the material the skin encloses a
positive volume and a cavity a negative one; `cavities` turns its faces so that they point out of the cavity,
into the material.

Winding number of a closed surface around a point: Σ Ω / 4π over the solid angles Ω of its triangles
(A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30, 1983, DOI 10.1109/TBME.1983.325207).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from softfuse.errors import MeshError
from softfuse.mesh.tetmesh import FACES, FACES6, TetMesh

_TURN = np.array([0, 2, 1, 5, 4, 3])
"""Nodes of a face seen from its other side, mid-edge nodes (0,1), (1,2), (2,0) included."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Faces (f, 3) or (f, 6) and the tetrahedron (f,) that owns each.

    Six nodes are the corners, then the middles of the edges (0,1), (1,2), (2,0).
    """

    faces: Int[np.ndarray, "f k"]
    tets: Int[np.ndarray, " f"]

    def turned(self) -> "Surface":
        """The same faces with opposite normals."""
        return Surface(self.faces[:, _TURN[: self.faces.shape[1]]], self.tets)


def boundary_faces(mesh: TetMesh) -> Surface:
    """All faces that belong to one tetrahedron only, normals out of the material."""
    local = FACES if mesh.order == 1 else FACES6
    faces = mesh.tets[:, local].reshape(-1, local.shape[1])
    _, first, count = np.unique(np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    single = np.sort(first[count == 1])
    return Surface(faces[single], (single // 4).astype(np.int32))


def boundary_components(mesh: TetMesh) -> list[Surface]:
    """Connected closed parts of the boundary, normals out of the material, largest enclosed |volume| first.

    Raises MeshError when more than two faces of the boundary meet at an edge, so that parts touch along it.
    """
    surface = boundary_faces(mesh)
    count = len(surface.faces)
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, place, sharing = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    if (sharing != 2).any():
        at = int(np.argmax(sharing != 2))
        a, b = unique[at].tolist()
        raise MeshError(
            f"{sharing[at]} faces of the boundary meet at the edge of the nodes {a} and {b} near "
            f"{mesh.nodes[a]} m, two should: separate the parts that touch there, or remesh"
        )
    owners = (np.argsort(place, kind="stable") // 3).reshape(-1, 2)
    graph = coo_array((np.ones(len(owners)), (owners[:, 0], owners[:, 1])), shape=(count, count))
    n, label = connected_components(graph, directed=False)
    parts = [Surface(surface.faces[label == k], surface.tets[label == k]) for k in range(n)]
    return sorted(parts, key=lambda part: -abs(enclosed_volume(mesh.nodes, part.faces)))


def enclosed_volume(nodes: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f k"]) -> float:
    """Volume in m³ inside a closed surface of the flat triangles of the faces' corners; nodes in m."""
    a, b, c = (nodes[faces[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)


def centroid(nodes: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f k"]) -> Float[np.ndarray, "3"]:
    """Centre of gravity (3,) in m of the space inside a closed surface; nodes (n, 3) m."""
    origin = nodes[faces[:, :3]].mean(axis=(0, 1))
    a, b, c = (nodes[faces[:, k]] - origin for k in range(3))
    weight = np.einsum("fi,fi->f", a, np.cross(b, c))
    return origin + weight @ (a + b + c) / (4.0 * weight.sum())


def winding_number(
    points: Float[np.ndarray, "p 3"], nodes: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f k"]
) -> Float[np.ndarray, " p"]:
    """Turns (p,) of a closed surface around points (p, 3) m: 1 inside, 0 outside, for outward normals."""
    result = np.empty(len(points))
    block = 1 + 1_000_000 // len(faces)
    for at in range(0, len(points), block):
        part = slice(at, at + block)
        a, b, c = (nodes[faces[:, k]][None] - points[part, None] for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=-1)
        dots = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        result[part] = np.arctan2(volume, dots).sum(axis=1) / (2.0 * np.pi)
    return result


def outer_surface(mesh: TetMesh) -> Surface:
    """The skin of the body, normals out of the material; MeshError when the mesh falls into parts."""
    return _skin_and_cavities(mesh)[0]


def cavities(mesh: TetMesh, centres: Float[np.ndarray, "k 3"] | None = None) -> list[Surface]:
    """Closed inner surfaces, normals out of the cavity into the material (their enclosed volume is positive).

    centres (k, 3) m: where the config expects each cavity; the result follows their order. A centre belongs
    to the cavity that contains it, or else to the one with the nearest centroid. Without centres: by
    centroid, x first, then y, then z. Raises MeshError when the counts differ or two centres belong to the
    same cavity.
    """
    found = _skin_and_cavities(mesh)[1]
    middles = np.array([centroid(mesh.nodes, part.faces) for part in found]).reshape(-1, 3)
    if centres is None:
        grain = 1e-6 * np.ptp(mesh.nodes, axis=0).max()
        order = np.lexsort(np.round(middles / grain).T[::-1])
        return [found[k] for k in order]
    return [found[k] for k in _matched(mesh, found, middles, np.asarray(centres, float).reshape(-1, 3))]


def _matched(mesh: TetMesh, found: list[Surface], middles: np.ndarray, centres: np.ndarray) -> list[int]:
    if len(found) != len(centres):
        places = "; ".join(str((1e3 * m).round(2)) for m in middles[:8]) or "none"
        raise MeshError(
            f"config names {len(centres)} cavities, the mesh has {len(found)} closed inner surfaces "
            f"(centroids in mm: {places}): correct the config, or the mesh if a cavity is open or filled"
        )
    owner: list[int] = []
    inside = np.array([winding_number(centres, mesh.nodes, part.faces) > 0.5 for part in found])
    for k, centre in enumerate(centres):
        distance = np.linalg.norm(middles - centre, axis=1)
        best = int(np.argmax(inside[:, k])) if inside[:, k].any() else int(np.argmin(distance))
        if best in owner:
            raise MeshError(
                f"the cavity centres {owner.index(best)} and {k} of the config both belong to the cavity at "
                f"{(1e3 * middles[best]).round(2)} mm: move each into its own cavity"
            )
        owner.append(best)
    return owner


def _skin_and_cavities(mesh: TetMesh) -> tuple[Surface, list[Surface]]:
    parts = boundary_components(mesh)
    enclosed = [enclosed_volume(mesh.nodes, part.faces) for part in parts]
    skins = [part for part, volume in zip(parts, enclosed, strict=True) if volume > 0.0]
    if len(skins) != 1:
        places = "; ".join(str((1e3 * centroid(mesh.nodes, s.faces)).round(2)) for s in skins[:4])
        raise MeshError(
            f"the mesh falls into {len(skins)} parts without a common face, centred at {places} mm: join "
            "them so that their nodes and faces match, or keep one"
        )
    return skins[0], [part.turned() for part, volume in zip(parts, enclosed, strict=True) if volume < 0.0]
