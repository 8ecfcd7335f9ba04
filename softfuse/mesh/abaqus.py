"""Meshes in Abaqus input files: nodes, solid and surface elements, node sets, element sets, surfaces.

Elements of a family differ in how they are integrated and whether they have a pressure of their own, not in
their nodes: C3D4, C3D4H and C3D4T are all linear tetrahedra, C3D10, C3D10H, C3D10M, C3D10HS quadratic ones.
So a kind is told by the letters that begin its name and by its number of nodes.

Source: Abaqus 2016, Keywords Reference Guide and Elements Guide, Part VI (order of nodes and numbers of
faces).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from softfuse.errors import MeshError

if TYPE_CHECKING:
    import meshio

_SOLIDS = {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron"}
_SOLIDS |= {10: "tetra10", 15: "wedge15", 20: "hexahedron20"}
_SURFACES = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"}
_ELEMENT = re.compile(r"(C3D|S|STRI|M3D|SFM3D|R3D|CPS|CPE)(\d+)")

FACES = {
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": (
        *((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1)),
        *((1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    ),
}
"""Corners of the faces S1, S2, ... of each kind."""


@dataclass
class _Part:
    """What has been read so far: of elements the kind, the nodes' labels and the number of each block."""

    label: list[int] = field(default_factory=list)
    nodes: list[list[float]] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    cells: list[dict[int, list[int]]] = field(default_factory=list)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[list[str]]] = field(default_factory=dict)


def read_abaqus(path: Path) -> "meshio.Mesh":
    """The mesh in an input file: nodes in the file's unit, cells in blocks, sets of points, sets of cells.

    A surface becomes a block of triangles or quadrilaterals with a set of its name. Raises MeshError, which
    names the line, for what is no such file, an element without its nodes, several parts or included files.
    """
    part = _Part()
    text = path.read_text(encoding="utf-8", errors="replace")
    for number, keyword, options, rows in _keywords(text):
        try:
            _take(part, keyword, options, rows)
        except (ValueError, KeyError) as error:
            raise MeshError(
                f"{path}: line {number}: *{keyword} cannot be read ({error}): export it again"
            ) from error
    if not part.nodes or not part.cells:
        raise MeshError(
            f"{path} cannot be read as a mesh (no *NODE or *ELEMENT): export it as VTU or Gmsh 4.1"
        )
    return _mesh(part, path)


def _keywords(text: str) -> Iterator[tuple[int, str, dict[str, str], list[list[str]]]]:
    """Line, name, options and rows of data of each keyword; names and options in upper case."""
    found: tuple[int, str, dict[str, str], list[list[str]]] | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("**") or not line.strip():
            continue
        fields = [each.strip() for each in line.split(",")]
        if not line.startswith("*"):
            if found is not None:
                found[3].append(fields)
            continue
        if found is not None:
            yield found
        pairs = (each.partition("=") for each in fields[1:])
        options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
        found = number, fields[0][1:].upper(), options, []
    if found is not None:
        yield found


def _take(part: _Part, keyword: str, options: dict[str, str], rows: list[list[str]]) -> None:
    match keyword:
        case "NODE":
            labels = [int(row[0]) for row in rows]
            if set(labels) & set(part.label):
                raise ValueError("the file has several parts with nodes of the same numbers: export one part")
            part.label += labels
            part.nodes += [[float(x) for x in row[1:4]] for row in rows]
            _add(part.node_sets, options.get("NSET"), labels)
        case "ELEMENT":
            _take_elements(part, options, rows)
        case "NSET":
            _add(part.node_sets, options["NSET"], _members(options, rows, part.node_sets))
        case "ELSET":
            _add(part.element_sets, options["ELSET"], _members(options, rows, part.element_sets))
        case "SURFACE" if options.get("TYPE", "ELEMENT").upper() == "ELEMENT":
            part.surfaces.setdefault(options["NAME"], []).extend(rows)
        case "INCLUDE":
            raise ValueError("it names another file: put everything into one")


def _take_elements(part: _Part, options: dict[str, str], rows: list[list[str]]) -> None:
    name = options["TYPE"].upper()
    told = _ELEMENT.match(name)
    kinds = _SOLIDS if name.startswith("C3D") else _SURFACES
    numbers = [int(each) for row in rows for each in row if each]
    if told is None:
        return  # trusses, springs, masses: no part of a solid
    count = int(told[2])
    if count not in kinds:
        raise ValueError(f"an element {name} of {count} nodes")
    if len(numbers) % (count + 1):
        raise ValueError(f"not all of the elements {name} have {count} nodes")
    cells = {row[0]: row[1:] for row in np.reshape(numbers, (-1, count + 1)).tolist()}
    part.kinds.append(kinds[count])
    part.cells.append(cells)
    _add(part.element_sets, options.get("ELSET"), list(cells))


def _members(options: dict[str, str], rows: list[list[str]], sets: dict[str, list[int]]) -> list[int]:
    """Labels that rows of a set list, as ranges or by the names of other sets too."""
    found: list[int] = []
    for row in rows:
        given = [each for each in row if each]
        if "GENERATE" in options:
            first, last, *step = (int(each) for each in given)
            found += range(first, last + 1, *step)
        else:
            for each in given:
                found += [int(each)] if each.isdecimal() else sets[each]
    return found


def _add(sets: dict[str, list[int]], name: str | None, labels: list[int]) -> None:
    if name is not None:
        sets.setdefault(name, []).extend(labels)


def _mesh(part: _Part, path: Path) -> "meshio.Mesh":
    import meshio

    number = {label: k for k, label in enumerate(part.label)}
    kinds, cells = list(part.kinds), [list(block.values()) for block in part.cells]
    sets: dict[str, list[ArrayLike]] = {
        name: [_positions(block, labels) for block in part.cells]
        for name, labels in part.element_sets.items()
    }
    for name, rows in part.surfaces.items():
        for kind, faces in _faces(part, rows).items():
            for other in sets.values():
                other.append(np.zeros(0, int))
            sets.setdefault(name, [np.zeros(0, int)] * (len(cells) + 1))[-1] = np.arange(len(faces))
            kinds.append(kind)
            cells.append(faces)
    try:
        blocks: list[Any] = [
            meshio.CellBlock(kind, np.array([[number[each] for each in cell] for cell in block]))
            for kind, block in zip(kinds, cells, strict=True)
        ]
        points: dict[str, ArrayLike] = {
            name: np.array([number[each] for each in labels]) for name, labels in part.node_sets.items()
        }
    except KeyError as error:
        raise MeshError(f"{path}: there is no node {error}, which an element or a set names") from error
    return meshio.Mesh(np.array(part.nodes), blocks, point_sets=points, cell_sets=sets)


def _positions(block: dict[int, list[int]], labels: list[int]) -> np.ndarray:
    return np.flatnonzero(np.isin(np.fromiter(block, int, len(block)), labels))


def _faces(part: _Part, rows: list[list[str]]) -> dict[str, list[list[int]]]:
    """Corners of the faces that rows (element or set, S1 ...) name, by kind."""
    found: dict[str, list[list[int]]] = {}
    for of, side, *_ in rows:
        labels = [int(of)] if of.isdecimal() else part.element_sets.get(of, [])
        for kind, block in zip(part.kinds, part.cells, strict=True):
            family = FACES.get(re.sub(r"\d+$", "", kind))
            index = int(side[1:]) - 1 if re.fullmatch(r"S\d", side) else -1
            if family is None or not 0 <= index < len(family):
                continue
            for label in labels:
                if label in block:
                    corners = [block[label][k] for k in family[index]]
                    found.setdefault("triangle" if len(corners) == 3 else "quad", []).append(corners)
    return found
