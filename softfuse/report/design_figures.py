"""Pictures of a design run: what was tried, and what cavities look like before and after, in mm."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.report.figures import ESTIMATE, TRUTH, blank, colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def tried(searches: Mapping[str, Float[np.ndarray, " n"]], name: str, before: float) -> "Figure":
    """The objective, called `name`, of each trial (n,) of each search, NaN where a mesh was worn, over its
    number; and that of the device as it is.
    """
    figure = blank(8, 3.2)
    axes = figure.subplots()
    axes.axhline(before, color=TRUTH, lw=1, ls="--", label="device as it is")
    for k, (search, values) in enumerate(searches.items()):
        axes.plot(np.arange(1, len(values) + 1), values, ".-", lw=1, color=colour(k), label=search)
    axes.set(xlabel="trial", ylabel=name)
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="upper right", fontsize="small")
    axes.grid(alpha=0.3)
    return figure


def outlines(
    low_mm: Float[np.ndarray, "3"],
    high_mm: Float[np.ndarray, "3"],
    before_mm: Sequence[Float[np.ndarray, "m 3"]],
    after_mm: Sequence[Float[np.ndarray, "m 3"]],
) -> "Figure":
    """The block between two corners (3,) from above and from two sides, and the outlines of cavities of
    points (m, 3) before, dashed, and after.
    """
    from matplotlib.patches import Rectangle
    from scipy.spatial import ConvexHull

    figure = blank(12, 4.4)
    size = high_mm - low_mm
    for axes, (a, b) in zip(figure.subplots(1, 3), ((0, 1), (0, 2), (1, 2)), strict=True):
        axes.add_patch(Rectangle((low_mm[a], low_mm[b]), size[a], size[b], fill=False, color="0.2"))
        for cavities, style in ((before_mm, {"ls": "--", "color": TRUTH}), (after_mm, {"color": ESTIMATE})):
            for points in cavities:
                flat = points[:, [a, b]]
                ring = flat[np.append(ConvexHull(flat).vertices, ConvexHull(flat).vertices[:1])]
                axes.plot(*ring.T, lw=1.2, **style)
        axes.set(xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]", aspect="equal")
        axes.margins(0.05)
    return figure


def sensitivity_maps(
    x_mm: Float[np.ndarray, " s"],
    y_mm: Float[np.ndarray, " s"],
    values: Mapping[str, Float[np.ndarray, " s"]],
) -> "Figure":
    """One map for each of the values (s,) at places (s,), by its title, all in the same colours from 0."""
    figure = blank(4.6 * len(values), 3.9)
    most = max(float(np.max(value)) for value in values.values())
    for axes, (title, value) in zip(np.ravel(figure.subplots(1, len(values))), values.items(), strict=True):
        drawn = axes.scatter(x_mm, y_mm, c=value, s=90, marker="s", vmin=0.0, vmax=most, cmap="viridis")
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        axes.margins(0.12)
        figure.colorbar(drawn, ax=axes)
    return figure
