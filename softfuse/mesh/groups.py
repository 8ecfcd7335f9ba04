"""Named groups of a mesh file: physical groups of Gmsh, sets and surfaces of Abaqus, families of MED, tags of
medit and VTK.

A group is kept as pairs of corners, the edges of its faces, cells or nodes, so that what a mesh gets in the
middle of these edges later belongs to it too; a node by itself is a pair with itself.
"""

from collections.abc import Iterator
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Int

from softfuse.errors import MeshError
from softfuse.mesh.tetmesh import EDGES, TetMesh

if TYPE_CHECKING:
    import meshio

TAGS = ("region", "gmsh:physical", "cell_tags", "medit:ref")
"""Cell data that tell material regions and, on faces, groups by number."""

_CORNERS = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6}
_CORNERS |= {"hexahedron": 8}
_SOLIDS = ("tetra", "pyramid", "wedge", "hexahedron")


def file_groups(raw: "meshio.Mesh", mesh: TetMesh) -> dict[str, Int[np.ndarray, "_ 2"]]:
    """The groups of a file by name as pairs of corners of its mesh, whose nodes have the file's numbers."""
    found: dict[str, list[np.ndarray]] = {}
    for name, block, cells in _cell_groups(raw):
        kind = block.type.rstrip("0123456789")
        if kind in _CORNERS and len(cells):
            corners = np.asarray(block.data)[np.asarray(cells, int), : _CORNERS[kind]]
            pairs = np.array(list(combinations_with_replacement(range(_CORNERS[kind]), 2)))
            found.setdefault(name, []).append(corners[:, pairs].reshape(-1, 2))
    edges = mesh.tets[:, EDGES].reshape(-1, 2)
    for name, nodes in _node_groups(raw):
        there = np.zeros(len(mesh.nodes), bool)
        there[np.asarray(nodes, int)] = True
        own = np.flatnonzero(there)
        found.setdefault(name, []).extend([np.column_stack([own, own]), edges[there[edges].all(axis=1)]])
    return {name: np.unique(np.sort(np.vstack(pairs), axis=1), axis=0) for name, pairs in found.items()}


def group_nodes(mesh: TetMesh, name: str) -> Bool[np.ndarray, " n"]:
    """Which nodes (n,) of a mesh are in a group; MeshError, which lists them all, where there is none of this
    name, or it holds no node.
    """
    pairs = mesh.groups.get(name)
    if pairs is None:
        there = ", ".join(f'"{each}"' for each in sorted(mesh.groups)) or "none"
        raise MeshError(f'the mesh has no group "{name}", its groups are: {there}')
    inside = np.zeros(len(mesh.nodes), bool)
    inside[pairs] = True
    if mesh.order == 2:
        count = len(mesh.nodes)
        ends = np.sort(mesh.tets[:, EDGES], axis=-1).astype(np.int64)
        own = np.isin(ends[..., 0] * count + ends[..., 1], pairs[:, 0].astype(np.int64) * count + pairs[:, 1])
        inside[mesh.tets[:, 4:][own]] = True
    if not inside.any():
        raise MeshError(f'the group "{name}" holds no node of a tetrahedron')
    return inside


def _cell_groups(raw: "meshio.Mesh") -> Iterator[tuple[str, "meshio.CellBlock", np.ndarray]]:
    """Name, block and positions in it of what is in each group."""
    for name, parts in raw.cell_sets.items():
        if not name.startswith("gmsh:"):
            pairs = zip(raw.cells, parts, strict=False)
            yield from ((name, block, np.asarray(part)) for block, part in pairs)
    tags = next((raw.cell_data[name] for name in TAGS if name in raw.cell_data), None)
    if tags is None:
        return
    dimension = {kind: k for k, kinds in enumerate((("triangle", "quad"), _SOLIDS)) for kind in kinds}
    named = {(int(tag), int(at)): name for name, (tag, at) in _physical(raw).items()}
    families = getattr(raw, "cell_tags", {})
    flat = [part for block, part in zip(raw.cells, tags, strict=True) if _family(block) not in _SOLIDS]
    taken = {int(tag) for part in flat for tag in np.ravel(part)}
    for block, part in zip(raw.cells, tags, strict=True):
        kind = _family(block)
        for tag in np.unique(part):
            inside = np.flatnonzero(np.ravel(part) == tag)
            names = list(families.get(int(tag), ()))
            names += [named[key] for key in [(int(tag), dimension.get(kind, 0) + 2)] if key in named]
            if tag != 0 and (kind not in _SOLIDS or int(tag) not in taken):
                names.append(f"{int(tag)}")
            yield from ((name, block, inside) for name in names)


def _family(block: "meshio.CellBlock") -> str:
    return block.type.rstrip("0123456789")


def _physical(raw: "meshio.Mesh") -> dict[str, np.ndarray]:
    """Gmsh's names of physical groups, each with its number and dimension."""
    return {name: value for name, value in raw.field_data.items() if np.shape(value) == (2,)}


def _node_groups(raw: "meshio.Mesh") -> Iterator[tuple[str, np.ndarray]]:
    yield from ((name, np.asarray(nodes)) for name, nodes in raw.point_sets.items())
    families = getattr(raw, "point_tags", {})
    for name, values in raw.point_data.items():
        values = np.asarray(values)
        if name == "point_tags":
            for tag, names in families.items():
                yield from ((each, np.flatnonzero(values == tag)) for each in names)
        elif values.ndim == 1 and np.isin(values, (0, 1)).all() and values.any():
            yield name, np.flatnonzero(values)
