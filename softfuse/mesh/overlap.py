"""Closed parts of a surface that lie inside each other, cross or touch.

Whether a part is inside another is judged by the volume that both have in common: all of the smaller
one, none of it, or a piece, where they cross. CAD programs export assemblies with parts that penetrate or
touch each other; those that are wound alike stand for one piece of material, or for one hole, and are united.
Volumes and unions are exact to rounding (manifold3d).
"""

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from softfuse.errors import MeshError

if TYPE_CHECKING:
    from manifold3d import Manifold

log = logging.getLogger(__name__)

_SLIVER = 1e-9
"""Part of the smaller volume below which a common volume is rounding."""


def solid(nodes: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> "Manifold":
    """What a closed surface with outward normals encloses; raises MeshError where it is no manifold."""
    from manifold3d import Error, Manifold, Mesh64

    used, place = np.unique(faces, return_inverse=True)
    mesh = Mesh64(np.ascontiguousarray(nodes[used]), place.reshape(-1, 3).astype(np.uint64))
    found = Manifold(mesh)
    if found.status() != Error.NoError:
        raise MeshError(f"the surface encloses no solid ({found.status().name}): repair it")
    return found


def outline(of: "Manifold") -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
    """Nodes (n, 3) m and faces (f, 3) of a solid's surface."""
    mesh = of.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def nested_parts(
    nodes: Float[np.ndarray, "n 3"], parts: Sequence[Int[np.ndarray, "_ 3"]], volume: Sequence[float]
) -> tuple[Bool[np.ndarray, "k k"], list[list[int]]]:
    """Whether part k is inside part j, [k, j], and the groups of parts that cross or touch from outside.

    parts: closed surfaces by their faces, of the signed volumes (k,) m³. Raises MeshError, which names the
    parts, where one touches another from inside, or where two cross that are wound differently.
    """
    solids = [solid(nodes, f if v > 0 else f[:, ::-1]) for f, v in zip(parts, volume, strict=True)]
    boxes = np.array([np.array(each.bounding_box()).reshape(2, 3) for each in solids])
    inside = np.zeros((len(parts), len(parts)), bool)
    joined = np.zeros((len(parts), len(parts)), bool)
    for j in range(len(parts)):
        for k in range(j):
            if (boxes[j, 0] > boxes[k, 1]).any() or (boxes[k, 0] > boxes[j, 1]).any():
                continue
            small, big = (j, k) if abs(volume[j]) < abs(volume[k]) else (k, j)
            common = (solids[j] ^ solids[k]).volume()
            least = solids[small].volume()
            where = f"parts {_place(boxes, k)} and {_place(boxes, j)} of the surface"
            if common > (1.0 - _SLIVER) * least:
                if len((solids[big] - solids[small]).decompose()) != 2:
                    raise MeshError(
                        f"{where} touch, the one inside the other: leave a wall between them, or cut the "
                        "inner one out of the outer one in the CAD program"
                    )
                inside[small, big] = True
            elif common > _SLIVER * least or len((solids[j] + solids[k]).decompose()) < 2:
                if (volume[j] > 0.0) != (volume[k] > 0.0):
                    raise MeshError(
                        f"{where} cross or touch, and one of them is wound as a hole: cut it out of the "
                        "other one in the CAD program, or turn its normals to join them"
                    )
                joined[k, j] = True
    count, label = connected_components(joined, directed=False)
    groups = [np.flatnonzero(label == g).tolist() for g in range(count)]
    return inside, [group for group in groups if len(group) > 1]


def united(
    nodes: Float[np.ndarray, "n 3"],
    parts: Sequence[Int[np.ndarray, "_ 3"]],
    volume: Sequence[float],
    groups: Sequence[Sequence[int]],
) -> tuple[Float[np.ndarray, "n2 3"], Int[np.ndarray, "f2 3"]]:
    """The surface with each group of parts as one; what `nested_parts` was given, and its groups."""
    loose = set(range(len(parts))) - {k for group in groups for k in group}
    pieces = [(nodes, parts[k]) for k in sorted(loose)]
    for group in groups:
        whole, *others = (solid(nodes, parts[k] if volume[k] > 0 else parts[k][:, ::-1]) for k in group)
        for other in others:
            whole = whole + other
        own, faces = outline(whole)
        pieces.append((own, faces if volume[group[0]] > 0 else faces[:, ::-1]))
        log.warning(
            "parts %s of the surface cross or touch: joined to one of %.6g mm³",
            ", ".join(map(str, group)),
            1e9 * whole.volume(),
        )
    starts = np.cumsum([0, *(len(own) for own, _ in pieces[:-1])])
    return (
        np.vstack([own for own, _ in pieces]),
        np.vstack([faces + start for (_, faces), start in zip(pieces, starts, strict=True)]),
    )


def _place(boxes: Float[np.ndarray, "k 2 3"], k: int) -> str:
    return f"{k} (around {(1e3 * boxes[k].mean(axis=0)).round(2).tolist()} mm)"
