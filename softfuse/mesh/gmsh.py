"""Meshes in Gmsh's format 4.1, with all physical groups, whether they cover the whole mesh or a part of it.

meshio refuses a file in which some entities belong to a physical group and others do not, and takes one group
of each entity. Here untagged cells have the number 0, and an entity is in all of its groups.

Source: Gmsh 4.13 reference manual, "MSH file format" and "Node ordering".
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike

from softfuse.errors import MeshError

if TYPE_CHECKING:
    import meshio

_KINDS = {
    1: ("line", 2, 1),
    2: ("triangle", 3, 2),
    3: ("quad", 4, 2),
    4: ("tetra", 4, 3),
    5: ("hexahedron", 8, 3),
    6: ("wedge", 6, 3),
    7: ("pyramid", 5, 3),
    8: ("line3", 3, 1),
    9: ("triangle6", 6, 2),
    10: ("quad9", 9, 2),
    11: ("tetra10", 10, 3),
    12: ("hexahedron27", 27, 3),
    13: ("wedge18", 18, 3),
    14: ("pyramid14", 14, 3),
    15: ("vertex", 1, 0),
    16: ("quad8", 8, 2),
    17: ("hexahedron20", 20, 3),
    18: ("wedge15", 15, 3),
    19: ("pyramid13", 13, 3),
}
"""Gmsh's number of a kind of cell: meshio's name, number of nodes, dimension."""

_ORDER = {
    "tetra10": (4, 5, 6, 7, 9, 8),
    "pyramid13": (5, 8, 10, 6, 7, 9, 11, 12),
    "wedge15": (6, 9, 7, 12, 14, 13, 8, 10, 11),
    "hexahedron20": (8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
}
"""Gmsh's places of the mid-edge nodes in VTK's order."""
_ORDER |= {"pyramid14": _ORDER["pyramid13"], "wedge18": _ORDER["wedge15"]}
_ORDER |= {"hexahedron27": _ORDER["hexahedron20"]}

_INT, _SIZE, _REAL = np.dtype("<i4"), np.dtype("<u8"), np.dtype("<f8")


_Cells = tuple[int, int, str, np.ndarray, np.ndarray]
"""Dimension and tag of an entity, kind, labels of cells (c,), labels of their nodes (c, k)."""


class _Numbers:
    """The numbers of a section, one after the other, from text or from bytes."""

    def __init__(self, file: BinaryIO, *, text: bool):
        self._file, self._sep = file, " " if text else ""

    @property
    def text(self) -> bool:
        """Whether they are written as text."""
        return bool(self._sep)

    def take(self, dtype: np.dtype, count: int | np.uint64) -> np.ndarray:
        found = np.fromfile(self._file, dtype, int(count), sep=self._sep)
        if len(found) != count:
            raise ValueError("the file ends too early")
        return found


def is_gmsh_41(path: Path) -> bool:
    """Whether a file is of this format, of the size of numbers that is read here."""
    with path.open("rb") as file:
        for line in iter(file.readline, b""):
            if line.strip() == b"$MeshFormat":
                version, _, size = (*file.readline().split()[:3], b"", b"", b"")[:3]
                return version == b"4.1" and size == b"8"
            if line.strip() not in (b"", b"$Comments") and not line.startswith(b"$EndComments"):
                continue
    return False


def read_gmsh_41(path: Path) -> "meshio.Mesh":
    """The mesh in a file: nodes in its unit, cells by entity, physical groups as "gmsh:physical" and sets.

    Of an entity in several groups "gmsh:physical" is the first. Raises MeshError for a file that is damaged
    or split into partitions.
    """
    names: dict[tuple[int, int], str] = {}
    groups: dict[tuple[int, int], list[int]] = {}
    nodes, label, blocks = np.zeros((0, 3)), np.zeros(0, int), []
    fields: dict[str, dict[str, np.ndarray]] = {"NodeData": {}, "ElementData": {}}
    try:
        with path.open("rb") as file:
            for section, numbers in _sections(file):
                match section:
                    case "PhysicalNames":
                        names = _names(file)
                    case "Entities":
                        groups = _entities(numbers)
                    case "PartitionedEntities":
                        raise ValueError("it is split into partitions: save it as one")
                    case "Nodes":
                        label, nodes = _nodes(numbers)
                    case "Elements":
                        blocks = _elements(numbers)
                    case "NodeData" | "ElementData":
                        name, values = _field(file, numbers)
                        fields[section][name] = values
        return _mesh(nodes, label, blocks, groups, names, fields)
    except (ValueError, IndexError, KeyError, OSError, OverflowError, MemoryError) as error:
        told = " ".join(str(error).split()) or "it is damaged"
        raise MeshError(f"{path} cannot be read as a mesh ({told}): export it as VTU or Gmsh 4.1") from error


def _sections(file: BinaryIO) -> Iterator[tuple[str, _Numbers]]:
    """Name of each section, the file standing behind it, and its numbers."""
    text = True
    for line in iter(file.readline, b""):
        name = line.strip().decode("ascii", "replace")
        if not name.startswith("$") or name.startswith("$End"):
            continue
        if name == "$MeshFormat":
            text = file.readline().split()[1] == b"0"
            continue
        yield name[1:], _Numbers(file, text=text)


def _names(file: BinaryIO) -> dict[tuple[int, int], str]:
    found = {}
    for _ in range(int(file.readline())):
        dimension, number, name = file.readline().decode("utf-8", "replace").split(maxsplit=2)
        found[int(dimension), int(number)] = name.strip().strip('"')
    return found


def _entities(numbers: _Numbers) -> dict[tuple[int, int], list[int]]:
    """Numbers of the physical groups of each entity, by dimension and tag."""
    found = {}
    for dimension, count in enumerate(numbers.take(_SIZE, 4)):
        for _ in range(int(count)):
            tag = int(numbers.take(_INT, 1)[0])
            numbers.take(_REAL, 3 if dimension == 0 else 6)
            found[dimension, tag] = numbers.take(_INT, numbers.take(_SIZE, 1)[0]).tolist()
            if dimension:
                numbers.take(_INT, numbers.take(_SIZE, 1)[0])
    return found


def _nodes(numbers: _Numbers) -> tuple[np.ndarray, np.ndarray]:
    blocks, *_ = numbers.take(_SIZE, 4)
    labels, places = [], []
    for _ in range(int(blocks)):
        dimension, _, parametric = numbers.take(_INT, 3)
        count = numbers.take(_SIZE, 1)[0]
        labels.append(numbers.take(_SIZE, count))
        width = 3 + (int(dimension) if parametric else 0)
        places.append(numbers.take(_REAL, int(count) * width).reshape(-1, width)[:, :3])
    return np.concatenate(labels).astype(int), np.vstack(places)


def _elements(numbers: _Numbers) -> list[_Cells]:
    found = []
    blocks, *_ = numbers.take(_SIZE, 4)
    for _ in range(int(blocks)):
        dimension, tag, number = (int(each) for each in numbers.take(_INT, 3))
        count = numbers.take(_SIZE, 1)[0]
        if number not in _KINDS:
            raise ValueError(
                f"it has {count} cells of Gmsh's kind {number}, of higher order: export order 1 or 2"
            )
        kind, width, _ = _KINDS[number]
        rows = numbers.take(_SIZE, int(count) * (width + 1)).reshape(-1, width + 1).astype(int)
        cells = rows[:, 1:]
        if kind in _ORDER:
            corners = min(_ORDER[kind])
            cells = cells[:, [*range(corners), *_ORDER[kind], *range(corners + len(_ORDER[kind]), width)]]
        found.append((dimension, tag, kind, rows[:, 0], cells))
    return found


def _field(file: BinaryIO, numbers: _Numbers) -> tuple[str, np.ndarray]:
    """Name, labels and first components (r, 2) of data at nodes or cells."""
    strings, _, integers = ([file.readline() for _ in range(int(file.readline()))] for _ in range(3))
    width, count = int(integers[1]), int(integers[2])
    if numbers.text:
        rows = numbers.take(_REAL, count * (1 + width)).reshape(count, -1)
    else:
        raw = numbers.take(np.dtype([("label", _INT), ("value", _REAL, (width,))]), count)
        rows = np.column_stack([raw["label"], raw["value"]])
    return strings[0].decode("utf-8", "replace").strip().strip('"'), rows[:, :2]


def _mesh(
    nodes: np.ndarray,
    label: np.ndarray,
    blocks: list[_Cells],
    groups: dict[tuple[int, int], list[int]],
    names: dict[tuple[int, int], str],
    fields: dict[str, dict[str, np.ndarray]],
) -> "meshio.Mesh":
    import meshio

    if not len(nodes) or not blocks:
        raise ValueError("no $Nodes or no $Elements")
    place = np.full(label.max() + 1, -1)
    place[label] = np.arange(len(label))
    cells: list[Any] = [meshio.CellBlock(kind, place[cell]) for _, _, kind, _, cell in blocks]
    if any((block.data < 0).any() for block in cells):
        raise ValueError("an element names a node that is not there")
    own = [groups.get((dimension, tag), []) for dimension, tag, *_ in blocks]
    physical = [np.full(len(b.data), abs(g[0]) if g else 0) for b, g in zip(cells, own, strict=True)]
    sets: dict[str, list[ArrayLike]] = {
        name: [
            np.arange(len(b.data) if dimension == at and number in map(abs, g) else 0)
            for b, g, (at, *_) in zip(cells, own, blocks, strict=True)
        ]
        for (dimension, number), name in names.items()
    }
    cell_data: dict[str, list[ArrayLike]] = {"gmsh:physical": [*physical]} if any(own) else {}
    for name, rows in fields["ElementData"].items():
        cell_data[name] = [_at(rows, labels) for _, _, _, labels, _ in blocks]
    points: dict[str, ArrayLike] = {name: _at(rows, label) for name, rows in fields["NodeData"].items()}
    return meshio.Mesh(nodes, cells, point_data=points, cell_data=cell_data, cell_sets=sets)


def _at(rows: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """The value (l,) in rows (r, 2) of label and value of each label (l,), 0 where there is none."""
    values = np.zeros(max(labels.max(initial=0), rows[:, 0].max(initial=0)).astype(int) + 1)
    values[rows[:, 0].astype(int)] = rows[:, 1]
    return values[labels]
