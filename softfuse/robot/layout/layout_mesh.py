"""A mesh of a layout whose nodes follow the parameters, differentiably, with the same tetrahedra.

A structured mesh (see `mesh.block`) holds a box in the place of each cavity, of the same volume and
proportions. Each node on the box's wall belongs to the nearest point of the cavity at the θ that the mesh is
made for, lengths counted over √h; this is a direction u of the cavity's own and stays one: x(u; θ). The nodes
between walls and skin follow harmonically,

    X(θ) = X_boxes + H (x_walls(θ) − X_boxes,walls),     H (nodes, walls) the extension, 0 on the skin.

Nodes in the middle of edges on walls belong to the surface too, so that faces are curved and the volume
inside them is nearly that of the cavity; where an edge bridges a narrow fillet, or a tetrahedron would turn
inside out, they stay nearer to its chord. What such faces cut off is made up for: nodes lie on cavities whose
half-sizes are larger by what brings the volume back. When the tetrahedra are no longer well shaped at θ, a
mesh that is made for that θ goes on from there: the parameters stay what they are. As long as faces of boxes
keep their order along each axis, it has the same tetrahedra, only stretched from the old planes to the new
ones, so that hardly anything jumps (`remade`).

Faces of boxes that look the same way and lie nearly in a plane are put into one plane, so that no thin slices
arise between them: the boxes are only where the mesh comes from.
"""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity
from softfuse.mesh.block import Fineness, block_mesh
from softfuse.mesh.morph import harmonic_extension
from softfuse.mesh.quality import curved_mean_ratios
from softfuse.mesh.subdivision import subdivided
from softfuse.mesh.surface import Surface, cavities, enclosed_volume, outer_surface
from softfuse.mesh.tetmesh import TetMesh, quadratic, tet_mesh
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.cube_sphere import cube_sphere
from softfuse.robot.layout.direction_search import greatest
from softfuse.robot.layout.layout import AbstractLayout

_ONE_PLANE = 0.3
"""Distance over base_size up to which faces of boxes that look the same way share a plane."""

_BULGE = 0.1
"""Largest height of a curved edge over its chord, as a part of the chord's length, when a mesh is made."""

_FLAT = 0.05
"""Mean ratio below which curved edges of a tetrahedron are brought nearer to their chords."""

_HALVINGS = 6
"""Times that they are brought half as near."""

_STRETCH = 2.0
"""By how many times a gap between planes may change before a mesh has other tetrahedra."""

_WORN = 0.5
"""Part of the mesh's least quality when it was made below which a new one is due."""

_BOX_DIRECTIONS, _DIRECTIONS = 20, 100
"""Cells along an edge of the cube whose directions measure a cavity's volume, for its box and its mesh."""

_GROWTHS = 2
"""Times that cavities are grown."""

_TRIAL_M = 1e-5
"""By how much they are grown to see what that does."""


class LayoutMesh(eqx.Module):
    """How the nodes (n,) of a quadratic mesh follow the parameters of a layout; `layout_mesh` makes it.

    corners (k, 2, 3): lowest and highest in m of the boxes; boxes (n, 3): nodes in m of the mesh with them;
    wall (w,): those on walls, cavity by cavity; directions
    (w_k, 3): of each cavity's; ends (w, 2): places in `wall` of the ends of the edge that each is in the
    middle of, or its own twice; curving (w,) [-]: 1 on the surface, 0 on the chord; grown (k,) m: by how much
    half-sizes are larger than they should be, so that cavities of such faces have their volumes; extension
    (n, w) [-]: H; tets (m, 10); walls: the cavities' faces, normals into the material; made_quality [-]:
    `quality` for the θ that it was made for.
    """

    layout: AbstractLayout
    corners: Float[np.ndarray, "k 2 3"]
    boxes: Float[Array, "n 3"]
    wall: Int[Array, " w"]
    directions: tuple[Float[Array, "_ 3"], ...]
    ends: Int[Array, "w 2"]
    curving: Float[Array, " w"]
    grown: Float[Array, " k"]
    extension: Float[Array, "n w"]
    tets: Int[np.ndarray, "m 10"]
    walls: tuple[Surface, ...] = eqx.field(static=True)
    made_quality: float = eqx.field(static=True)

    def rest(self, theta: Float[Array, " p"]) -> Float[Array, "n 3"]:
        """Rest positions (n, 3) m of all nodes with parameters (p,); differentiable in both modes."""
        layout = self.layout
        parts = zip(layout.shapes, layout.values(theta), self.directions, self.grown, strict=True)
        points = [shape.points(shape.grown(values, more), along) for shape, values, along, more in parts]
        surface = jnp.concatenate([jnp.zeros((0, 3)), *points])
        chord = jnp.mean(surface[self.ends], axis=1)
        placed = chord + self.curving[:, None] * (surface - chord)
        return self.boxes + self.extension @ (placed - self.boxes[self.wall])

    def mesh(self, theta: Float[Array | np.ndarray, " p"]) -> TetMesh:
        """The quadratic mesh with parameters (p,)."""
        return tet_mesh(np.asarray(self.rest(jnp.asarray(theta))), self.tets)

    def quality(self, theta: Float[Array | np.ndarray, " p"]) -> float:
        """The least mean ratio [-] of the tetrahedra with parameters (p,), see `curved_mean_ratios`; 0 or
        less where one is turned inside out.
        """
        return float(curved_mean_ratios(self.mesh(theta)).min())

    def worn(self, theta: Float[Array | np.ndarray, " p"]) -> bool:
        """Whether a new mesh is due with parameters (p,): the least quality is less than half of what it was
        when the mesh was made.
        """
        return not self.quality(theta) > _WORN * self.made_quality


def layout_mesh(
    layout: AbstractLayout, theta: Float[Array | np.ndarray, " p"], fineness: Fineness
) -> LayoutMesh:
    """A mesh made for parameters (p,), which follows others.

    Raises MeshError when boxes in the place of the cavities do not fit into the outline, or the cavities are
    turned or shaped so unlike boxes that tetrahedra turn inside out.
    """
    boxes = _aligned(_boxes(layout, jnp.asarray(theta)), _ONE_PLANE * fineness.base_size)
    straight = block_mesh(replace(layout.outline, cavities=boxes), fineness.base_size, fineness.longest)
    mesh = quadratic(straight)
    return _made(layout, jnp.asarray(theta), boxes, mesh, cavities(mesh, boxes.mean(axis=1)))


def remade(mesh: LayoutMesh, theta: Float[Array | np.ndarray, " p"], fineness: Fineness) -> LayoutMesh:
    """A mesh made for parameters (p,), with the tetrahedra of another of the same layout where these can be
    stretched, see `layout_mesh` for the errors.
    """
    layout, outline = mesh.layout, mesh.layout.outline
    boxes = _boxes(layout, jnp.asarray(theta))
    stretched = np.array(mesh.boxes)
    for axis in range(3):
        planes, group = np.unique(mesh.corners[..., axis], return_inverse=True)
        group = group.reshape(boxes.shape[:2])
        boxes[..., axis] = np.array([boxes[..., axis][group == k].mean() for k in range(len(planes))])[group]
        still = np.append(outline.notches[..., axis].ravel(), [outline.low[axis], outline.high[axis]])
        before = np.append(planes, still)
        after = np.append([boxes[..., axis][group == k][0] for k in range(len(planes))], still)
        before, first = np.unique(before, return_index=True)
        after = after[first]
        change = np.diff(after) / np.diff(before)
        if not ((change > 1.0 / _STRETCH) & (change < _STRETCH)).all():
            return layout_mesh(layout, theta, fineness)
        stretched[:, axis] = np.interp(stretched[:, axis], before, after)
    return _made(layout, jnp.asarray(theta), boxes, tet_mesh(stretched, mesh.tets), mesh.walls)


def _made(
    layout: AbstractLayout,
    theta: Float[Array, " p"],
    boxes: Float[np.ndarray, "k 2 3"],
    mesh: TetMesh,
    walls: Sequence[Surface],
) -> LayoutMesh:
    """What follows the layout, from the mesh of the boxes."""
    nodes = [np.unique(part.faces) for part in walls]
    parts = zip(layout.shapes, layout.values(theta), nodes, boxes, strict=True)
    directions = [
        _nearest(shape, values, jnp.asarray(mesh.nodes[own]), box) for shape, values, own, box in parts
    ]
    wall = np.concatenate([np.empty(0, np.int64), *nodes])
    ends = _ends(mesh, walls, wall)
    surface = np.concatenate([np.empty((0, 3)), *layout.points(theta, directions)])
    held = np.concatenate([wall, np.unique(outer_surface(mesh).faces)])
    made = LayoutMesh(
        layout=layout,
        corners=boxes,
        boxes=jnp.asarray(mesh.nodes),
        wall=jnp.asarray(wall),
        directions=tuple(directions),
        ends=jnp.asarray(ends),
        curving=jnp.asarray(_curving(surface, ends)),
        grown=jnp.zeros(len(layout.shapes)),
        extension=jnp.asarray(harmonic_extension(subdivided(mesh), held, np.eye(len(held), len(wall)))),
        tets=mesh.tets,
        walls=tuple(walls),
        made_quality=1.0,
    )
    made = _of_volume(_straightened(made, theta), theta)
    _check(made.mesh(theta))
    return replace(made, made_quality=made.quality(theta))


def _boxes(layout: AbstractLayout, theta: Float[Array, " p"]) -> Float[np.ndarray, "k 2 3"]:
    """Lowest and highest corners (k, 2, 3) m of boxes of the cavities' volumes."""
    boxes = np.empty((len(layout.shapes), 2, 3))
    for box, shape, values in zip(boxes, layout.shapes, layout.values(theta), strict=True):
        half = np.asarray(shape.half_sizes(values))
        if not half.min() > 0 or (np.asarray(shape.slack(values)) < 0).any():
            raise MeshError(
                f"a cavity around {(1e3 * np.asarray(shape.centre(values))).round(3).tolist()} mm with "
                f"half-sizes {(1e3 * half).round(3).tolist()} mm does not exist: make it larger, or its "
                "fillets smaller"
            )
        volume = _volume(shape, values, _BOX_DIRECTIONS)
        half = half * np.cbrt(volume / (8.0 * half.prod()))
        box[:] = np.asarray(shape.centre(values)) + np.stack([-half, half])
    return boxes


def _volume(shape: CavityShape, values: Float[Array, " v"], cells: int) -> float:
    """Volume in m³ of a cavity, by its points along the directions of so many cells."""
    directions, faces = cube_sphere(cells)
    return enclosed_volume(np.asarray(shape.points(values, directions)), faces)


def _aligned(boxes: Float[np.ndarray, "k 2 3"], apart: float) -> Float[np.ndarray, "k 2 3"]:
    """The boxes in common planes where these are no farther than `apart` m from their faces."""
    aligned = boxes.copy()
    for side in range(2):
        for axis in range(3):
            place = boxes[:, side, axis]
            order = np.argsort(place, kind="stable")
            first = 0
            for k in range(1, len(order) + 1):
                if k == len(order) or place[order[k]] - place[order[first]] > apart:
                    together = order[first:k]
                    aligned[together, side, axis] = place[together].mean()
                    first = k
    return aligned


@eqx.filter_jit
def _nearest(
    shape: CavityShape,
    values: Float[Array, " v"],
    nodes: Float[Array, "w 3"],
    box: Float[Array | np.ndarray, "2 3"],
) -> Float[Array, "w 3"]:
    """Directions (w, 3) of the cavity's points that are nearest to where nodes (w, 3) m on the wall of its
    box are when this is enlarged so that it holds the cavity, both as they are without a turn.
    """
    # Nearest by length, nodes would crowd on a flat cavity's rim; by length over h, they would leave out its
    # narrow fillets. From inside, they would go to the nearer of two sides and leave out what lies between.
    straight = values.at[6:9].set(0.0)
    offset = (nodes - jnp.mean(box, axis=0)) / (0.5 * (box[1] - box[0]))
    holding = jnp.maximum(*(shape.reach(straight, n * jnp.eye(3)) - n * values[:3] for n in (1.0, -1.0)))
    place = shape.centre(values) + holding * offset

    def nearness(directions):
        points = shape.points(straight, directions.reshape(-1, 3)).reshape(directions.shape)
        return -jnp.sum((points - place[:, None]) ** 2 / holding, axis=-1)

    begin = offset / jnp.linalg.norm(offset, axis=1, keepdims=True)
    return greatest(nearness, begin)


def _ends(mesh: TetMesh, walls: Sequence[Surface], wall: Int[np.ndarray, " w"]) -> Int[np.ndarray, "w 2"]:
    place = np.zeros(len(mesh.nodes), np.int64)
    place[wall] = np.arange(len(wall))
    ends = np.stack([np.arange(len(wall))] * 2, axis=1)
    for part in walls:
        for middle, corners in ((3, [0, 1]), (4, [1, 2]), (5, [2, 0])):
            ends[place[part.faces[:, middle]]] = place[part.faces[:, corners]]
    return ends


def _curving(surface: Float[np.ndarray, "w 3"], ends: Int[np.ndarray, "w 2"]) -> Float[np.ndarray, " w"]:
    chord = surface[ends]
    allowed = _BULGE * np.linalg.norm(chord[:, 1] - chord[:, 0], axis=1)
    height = np.linalg.norm(surface - chord.mean(axis=1), axis=1)
    return np.divide(allowed, height, out=np.ones_like(height), where=height > allowed)


def _straightened(made: LayoutMesh, theta: Float[Array, " p"]) -> LayoutMesh:
    """Edges of walls half as curved, and again, as long as their tetrahedra are flat or inside out."""
    place = np.full(len(made.boxes), -1)
    place[made.wall] = np.arange(len(made.wall))
    for _ in range(_HALVINGS):
        mesh = made.mesh(theta)
        flat = curved_mean_ratios(mesh) < _FLAT
        if not flat.any():
            break
        middles = np.unique(place[mesh.tets[flat, 4:]])
        less = made.curving.at[middles[middles >= 0]].multiply(0.5)
        made = replace(made, curving=less)
    return made


def _of_volume(made: LayoutMesh, theta: Float[Array, " p"]) -> LayoutMesh:
    """With cavities grown until they have their volumes, to first order in what is missing."""
    parts = zip(made.layout.shapes, made.layout.values(theta), strict=True)
    wanted = [_volume(shape, values, _DIRECTIONS) for shape, values in parts]

    def volumes(grown: Float[Array, " k"]) -> Float[Array, " k"]:
        rest = replace(made, grown=grown).rest(theta)
        return jnp.array([Cavity.of(wall.faces)(rest) for wall in made.walls])

    grown = made.grown
    for _ in range(_GROWTHS):
        found, more = volumes(grown), volumes(grown + _TRIAL_M)
        grown = grown + (jnp.array(wanted) - found) * _TRIAL_M / (more - found)
    return replace(made, grown=grown)


def _check(mesh: TetMesh) -> None:
    quality = curved_mean_ratios(mesh)
    if not quality.min() > 0.0:
        at = (1e3 * mesh.nodes[mesh.tets[np.argmin(quality)]].mean(axis=0)).round(2).tolist()
        raise MeshError(
            f"a tetrahedron near {at} mm is turned inside out between a cavity and what is next to it: "
            "thicken the wall there, turn the cavity less, or mesh finer"
        )
