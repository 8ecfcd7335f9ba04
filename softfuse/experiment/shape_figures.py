"""Deformed bodies in space with points and forces, as in Fig. 13 of Navarro et al. 2020; lengths in mm."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from softfuse.experiment.figures import blank

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

_SHARP = 0.8  # cosine between the normals of two faces below which their common edge is drawn
_VIEWS = (("from above", 90.0, -90.0), ("from the side", 0.0, -90.0), ("at an angle", 28.0, -62.0))


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
    """Each shape in three views, true to scale, over the edges of the body at rest."""
    figure = blank(12, 3.6 * len(seen))
    outline = 1e3 * rest_m[sharp_edges(rest_m, faces)]
    rows = figure.subfigures(len(seen), 1, squeeze=False)[:, 0]
    everything = np.concatenate([rest_m, *(shape.nodes_m for shape in seen)])
    low, high = 1e3 * everything.min(axis=0) - 3, 1e3 * everything.max(axis=0) + 3
    largest = max((float(np.linalg.norm(f)) for shape in seen for f in shape.force_N), default=0.0)
    for row, shape in zip(rows, seen, strict=True):
        row.suptitle(shape.title, fontsize="medium")
        for k, (name, elevation, azimuth) in enumerate(_VIEWS):
            axes = row.add_subplot(1, len(_VIEWS), k + 1, projection="3d", computed_zorder=False)
            _draw(axes, outline, faces, shape, 25 / largest if largest > 0 else 0.0)
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
            axes.set_box_aspect(high - low, zoom=1.35)
            axes.set_proj_type("ortho")
            axes.view_init(elev=elevation, azim=azimuth)
            axes.set_title(name, fontsize="small", y=0.95)
            axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
            axes.tick_params(labelsize=6)
            if elevation == 90.0:
                axes.set(zticks=[], zlabel="")
            elif elevation == 0.0:
                axes.set(yticks=[], ylabel="")
        rows[0].legend(*row.axes[0].get_legend_handles_labels(), loc="upper right", fontsize="small")
    return figure


def _draw(axes: "Axes3D", outline_mm: np.ndarray, faces: np.ndarray, shape: Shape, mm_per_N: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    corners = 1e3 * shape.nodes_m[faces]
    body = Poly3DCollection(corners, facecolors=(0.4, 0.6, 0.85, 0.25), edgecolors=(0.2, 0.3, 0.5, 0.25))
    body.set_linewidth(0.2)
    axes.add_collection3d(Line3DCollection(outline_mm, colors="0.6", linewidths=0.6, linestyles="--"))
    axes.add_collection3d(body)
    if shape.true_m is not None:
        axes.plot(*(1e3 * shape.true_m.T), "o", ms=6, mfc="none", color="0.15", label="true points")
    if len(shape.point_m):
        axes.plot(*(1e3 * shape.point_m.T), ".", ms=5, color="tab:red", label="estimated points")
    for place, force in zip(shape.contact_m, shape.force_N, strict=True):
        arrow = mm_per_N * force
        start = 1e3 * place - arrow
        axes.quiver(*start, *arrow, color="tab:green", lw=2, arrow_length_ratio=0.3)
