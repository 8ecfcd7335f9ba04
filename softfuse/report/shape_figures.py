"""Deformed bodies in space with points and forces, as in Fig. 13 of Navarro et al. 2020; lengths in mm."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from softfuse.report.figures import blank

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

_SHARP = 0.8  # cosine between the normals of two faces below which their common edge is drawn
_ARROW_MM, _LEAST_N = 25.0, 0.1  # length of the largest arrow; smaller largest forces get shorter arrows
_FILL, _EDGE, _REST, _FORCE = (0.45, 0.62, 0.85, 0.35), (0.15, 0.25, 0.45), "0.6", "tab:green"
_PLANES = (((0, 1), 2, "from above"), ((0, 2), 1, "from the side"))
"""Axes drawn to the right and upwards, the one looked along, name of the view."""


@dataclass(frozen=True, eq=False)
class Shape:
    """One deformed body: its title, nodes (k, 3) m, p estimated and true points (p, 3) m, NaN or none where
    unknown, c contacts at (c, 3) m and their force vectors (c, 3) N.
    """

    title: str
    nodes_m: Float[np.ndarray, "k 3"]
    point_m: Float[np.ndarray, "p 3"]
    true_m: Float[np.ndarray, "p 3"] | None
    contact_m: Float[np.ndarray, "c 3"]
    force_N: Float[np.ndarray, "c 3"]


def sharp_edges(rest_m: Float[np.ndarray, "k 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """The edges (e, 2) at which a closed surface of triangles (f, 3) turns by more than some 37 degrees."""
    corner = rest_m[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    # Each edge of a closed surface belongs to two faces: sorted, they follow each other.
    pair = owner[order].reshape(-1, 2)
    turned = np.sum(normal[pair[:, 0]] * normal[pair[:, 1]], axis=1) < _SHARP
    return edges[order][::2][turned]


def shapes(
    rest_m: Float[np.ndarray, "k 3"], faces: Int[np.ndarray, "f 3"], seen: Sequence[Shape]
) -> "Figure":
    """Each shape from above, from the side and at an angle, true to scale, over the body's edges at rest."""
    height = 3.1 * len(seen) + 0.5
    figure = blank(12.5, height)
    # Titles are wider than what they stand over, and artists in space larger than their axes.
    figure.set_layout_engine("none")
    across = {"left": 0.05, "right": 1.0, "wspace": 0.17, "width_ratios": (1.0, 1.0, 1.2)}
    upwards = {"bottom": 0.9 / height, "top": 1 - 0.3 / height, "hspace": 0.3}
    grid = figure.add_gridspec(len(seen), 3, **across, **upwards)
    edges = sharp_edges(rest_m, faces)
    everything = np.concatenate([rest_m, *(shape.nodes_m for shape in seen)])
    low, high = 1e3 * everything.min(axis=0) - 4, 1e3 * everything.max(axis=0) + 4
    largest = max((float(np.linalg.norm(f)) for shape in seen for f in shape.force_N), default=0.0)
    scale = _ARROW_MM / max(largest, _LEAST_N)
    for row, shape in enumerate(seen):
        for k, (plane, along, name) in enumerate(_PLANES):
            axes = figure.add_subplot(grid[row, k])
            _draw_flat(axes, 1e3 * rest_m, faces, edges, shape, plane, along, scale)
            margin = np.array([0.0, _ARROW_MM if largest > 0 and along == 2 else 0.0])
            (left, bottom), (right, top) = low[list(plane)] - margin, high[list(plane)] + margin
            axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
            axes.set(xlabel=f"x [mm], {name}", ylabel=f"{'xyz'[plane[1]]} [mm]")
        figure.axes[-2].set_title(shape.title, fontsize="medium", loc="left")
        space = figure.add_subplot(grid[row, 2], projection="3d", computed_zorder=False)
        space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        _draw_space(space, 1e3 * rest_m, faces, edges, shape, scale)
        space.set_box_aspect(high - low)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, fontsize="small")
    return figure


def _draw_flat(
    axes: "Axes",
    rest_mm: np.ndarray,
    faces: np.ndarray,
    edges: np.ndarray,
    shape: Shape,
    plane: tuple[int, int],
    along: int,
    mm_per_N: float,
) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    i, now = list(plane), 1e3 * shape.nodes_m
    # What is nearer to the eye is drawn later: it looks down the z axis or along the y axis.
    depth = now[faces][:, :, along].mean(axis=1) * (1 if along == 2 else -1)
    axes.add_collection(LineCollection(list(rest_mm[edges][..., i]), colors=_REST, linewidths=0.7))
    axes.add_collection(PolyCollection(list(now[faces[np.argsort(depth)]][..., i]), facecolors=[_FILL]))
    axes.add_collection(LineCollection(list(now[edges][..., i]), colors=[_EDGE], linewidths=0.8))
    if shape.true_m is not None:
        axes.plot(*(1e3 * shape.true_m[:, i].T), "o", ms=7, mfc="none", color="0.1", label="true points")
    if len(shape.point_m):
        axes.plot(*(1e3 * shape.point_m[:, i].T), ".", ms=6, color="tab:red", label="estimated points")
    arrow = mm_per_N * shape.force_N
    start = 1e3 * shape.contact_m - arrow
    axes.quiver(
        *start[:, i].T,
        *arrow[:, i].T,
        color=_FORCE,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.008,
        zorder=3,
        label=f"estimated forces, {mm_per_N:.0f} mm per N",
    )


def _draw_space(
    axes: "Axes3D",
    rest_mm: np.ndarray,
    faces: np.ndarray,
    edges: np.ndarray,
    shape: Shape,
    mm_per_N: float,
) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    now = 1e3 * shape.nodes_m
    body = Poly3DCollection(now[faces], facecolors=[_FILL], clip_on=False)
    axes.add_collection3d(Line3DCollection(rest_mm[edges], colors=_REST, linewidths=0.6, clip_on=False))
    axes.add_collection3d(body)
    axes.add_collection3d(Line3DCollection(now[edges], colors=[_EDGE], linewidths=0.8, clip_on=False))
    if shape.true_m is not None:
        axes.plot(*(1e3 * shape.true_m.T), "o", ms=6, mfc="none", color="0.1", clip_on=False)
    if len(shape.point_m):
        axes.plot(*(1e3 * shape.point_m.T), ".", ms=5, color="tab:red", clip_on=False)
    for place, force in zip(shape.contact_m, shape.force_N, strict=True):
        arrow = mm_per_N * force
        axes.quiver(*(1e3 * place - arrow), *arrow, color=_FORCE, lw=2, clip_on=False)
    axes.set_proj_type("ortho")
    axes.view_init(elev=28, azim=-62)
    axes.set(xlabel="x [mm]", yticks=[], zticks=[])
    axes.tick_params(labelsize=7)
