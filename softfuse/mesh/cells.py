"""Solid cells of other kinds cut into tetrahedra, alike from both sides of every face.

A convex cell is the cone from one of its corners over those of its faces that do not have this corner. With
the corner of the lowest number in the whole mesh as the apex of cells and, in the same way, of their
quadrilateral faces, two cells that share a face cut it along the same diagonal, whatever they are: a
hexahedron gives 6 tetrahedra, a wedge 3, a pyramid 2. Collapsed cells, with a corner named twice, give fewer.
Of quadratic cells the new edges get a node in their middle: on a face of serendipity shape functions, whose
value at the middle of a quadrilateral is Σ mid-edges / 2 − Σ corners / 4; inside the cell halfway.

Source: J. Dompierre, P. Labbé, M.-G. Vallet, R. Camarero, "How to subdivide pyramids, prisms, and hexahedra
into tetrahedra", 8th International Meshing Roundtable, 1999.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from softfuse.errors import MeshError
from softfuse.mesh.tetmesh import EDGES, FACES, TetMesh, tet_mesh


@dataclass(frozen=True)
class Solid:
    """Corners of a kind of cell, its faces of three or four corners around, and the ends of its edges in the
    order of its mid-edge nodes (VTK's).
    """

    corners: int
    faces: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]


_TETRAHEDRON = Solid(4, tuple(map(tuple, FACES.tolist())), tuple(map(tuple, EDGES.tolist())))
_PYRAMID = Solid(
    5,
    ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
)
_WEDGE = Solid(
    6,
    ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
)
_HEXAHEDRON = Solid(
    8,
    ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
)

LINEAR = {"tetra": _TETRAHEDRON, "pyramid": _PYRAMID, "wedge": _WEDGE, "hexahedron": _HEXAHEDRON}
QUADRATIC = {
    "tetra10": _TETRAHEDRON,
    **dict.fromkeys(("pyramid13", "pyramid14"), _PYRAMID),
    **dict.fromkeys(("wedge15", "wedge18"), _WEDGE),
    **dict.fromkeys(("hexahedron20", "hexahedron27"), _HEXAHEDRON),
}
"""Solids by meshio's names; nodes in the middles of faces and cells come last and are not used."""


@dataclass(frozen=True, eq=False)
class Block:
    """Cells (c, k) of one kind, by the numbers of their nodes, and the region (c,) of each."""

    kind: str
    cells: Int[np.ndarray, "c k"]
    region: Int[np.ndarray, " c"]


def tetrahedra(nodes: Float[np.ndarray, "n 3"], blocks: Sequence[Block]) -> TetMesh:
    """The mesh of nodes (n, 3) m and solid cells of any kinds in `LINEAR`, or of any in `QUADRATIC`.

    Its nodes begin with those given, under the same numbers. Raises MeshError for other kinds, and where
    linear and quadratic ones are mixed.
    """
    unknown = [block for block in blocks if block.kind not in LINEAR | QUADRATIC]
    if unknown:
        raise MeshError(f"{counted(unknown)} cannot be cut into tetrahedra: export tetrahedra or hexahedra")
    order = {block.kind in QUADRATIC for block in blocks}
    if len(order) > 1:
        raise MeshError(f"it mixes linear and quadratic cells ({counted(blocks)}): export one order of them")
    parts = [(block, _cut(LINEAR | QUADRATIC, block)) for block in blocks]
    tets = np.vstack([cut for _, (cut, _) in parts])
    region = np.concatenate([block.region[owner] for block, (_, owner) in parts])
    if order == {True}:
        nodes, tets = _with_middles(nodes, tets, blocks)
    return tet_mesh(nodes, tets, region=region)


def counted(blocks: Sequence[Block]) -> str:
    """How many cells there are of which kind: "12 hexahedron, 3 wedge"."""
    kinds = list(dict.fromkeys(block.kind for block in blocks))
    return ", ".join(f"{sum(len(b.cells) for b in blocks if b.kind == kind)} {kind}" for kind in kinds)


def _cut(solids: dict[str, Solid], block: Block) -> tuple[Int[np.ndarray, "m 4"], Int[np.ndarray, " m"]]:
    """Corners of the tetrahedra, and the cell that each is from."""
    solid = solids[block.kind]
    cells = block.cells[:, : solid.corners]
    if solid is _TETRAHEDRON:
        return cells, np.arange(len(cells))
    apex = cells.min(axis=1)
    tets, owner = [], []
    for face in solid.faces:
        for triangle in _triangles(cells[:, face]):
            whole = np.column_stack([triangle[:, ::-1], apex])
            # Faces at the apex, and pieces of collapsed cells, have a corner twice.
            kept = (np.diff(np.sort(whole, axis=1), axis=1) > 0).all(axis=1)
            tets.append(whole[kept])
            owner.append(np.flatnonzero(kept))
    return np.vstack(tets), np.concatenate(owner)


def _triangles(face: Int[np.ndarray, "c s"]) -> list[Int[np.ndarray, "c 3"]]:
    if face.shape[1] == 3:
        return [face]
    first = np.argmin(face, axis=1)[:, None]
    a, b, c, d = np.take_along_axis(face, (first + np.arange(4)) % 4, axis=1).T
    return [np.column_stack([a, b, c]), np.column_stack([a, c, d])]


def _with_middles(
    nodes: Float[np.ndarray, "n 3"], tets: Int[np.ndarray, "m 4"], blocks: Sequence[Block]
) -> tuple[Float[np.ndarray, "n2 3"], Int[np.ndarray, "m 10"]]:
    """The nodes with those that new edges need, and the tetrahedra with their mid-edge nodes."""
    count = len(nodes)
    keys, middles, places = [], [], []
    for block in blocks:
        solid = QUADRATIC[block.kind]
        ends, middle = np.array(solid.edges), block.cells[:, solid.corners :][:, : len(solid.edges)]
        keys.append(_key(block.cells[:, ends], count).ravel())
        middles.append(middle.ravel())
        number = {frozenset(edge): k for k, edge in enumerate(solid.edges)}
        for face in (face for face in solid.faces if len(face) == 4):
            around = [number[frozenset(pair)] for pair in zip(face, face[1:] + face[:1], strict=True)]
            corner, side = block.cells[:, face], middle[:, around]
            place = 0.5 * nodes[side].sum(axis=1) - 0.25 * nodes[corner].sum(axis=1)
            places.extend((_key(corner[:, pair], count), place) for pair in ([0, 2], [1, 3]))
    wanted, position = np.unique(_key(tets[:, EDGES], count), return_inverse=True)
    found = np.full(len(wanted), -1)
    _set(found, wanted, np.concatenate(keys), np.concatenate(middles))
    new = found < 0
    found[new] = count + np.arange(new.sum())
    at = 0.5 * (nodes[wanted // count] + nodes[wanted % count])
    for key, place in places:
        _set(at, wanted, key, place)
    return np.vstack([nodes, at[new]]), np.hstack([tets, found[position.reshape(len(tets), 6)]])


def _key(pairs: Int[np.ndarray, "... 2"], count: int) -> Int[np.ndarray, "..."]:
    """One number for the two ends of an edge in either order."""
    ends = np.sort(pairs, axis=-1).astype(np.int64)
    return ends[..., 0] * count + ends[..., 1]


def _set(values: np.ndarray, of: Int[np.ndarray, " w"], keys: Int[np.ndarray, " k"], new: np.ndarray) -> None:
    """Put new (k, ...) into values (w, ...) where the ascending `of` (w,) has their keys (k,)."""
    at = np.minimum(np.searchsorted(of, keys), len(of) - 1)
    there = of[at] == keys
    values[at[there]] = new[there]
