"""Maps over a workspace of what the sensors can tell of a contact, in N and mm."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.report.figures import blank

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def maps(
    x_mm: Float[np.ndarray, " a"],
    y_mm: Float[np.ndarray, " b"],
    values: dict[str, Float[np.ndarray, "a b"]],
) -> "Figure":
    """One map for each of the values (a, b), by its title, over x (a,) and y (b,); what is infinite is
    white.
    """
    figure = blank(4.6 * len(values), 3.9)
    for axes, (title, value) in zip(np.ravel(figure.subplots(1, len(values))), values.items(), strict=True):
        finite = np.where(np.isfinite(value), value, np.nan)
        drawn = axes.pcolormesh(x_mm, y_mm, finite.T, shading="nearest", cmap="viridis")
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        figure.colorbar(drawn, ax=axes)
    return figure


def spots(at_mm: Float[np.ndarray, "s 3"], values: dict[str, Float[np.ndarray, " s"]]) -> "Figure":
    """Places (s, 3) of a surface in space, one picture for each of the values (s,), by its title; what is
    infinite is white.
    """
    figure = blank(4.6 * len(values), 4.2)
    for k, (title, value) in enumerate(values.items(), start=1):
        axes = figure.add_subplot(1, len(values), k, projection="3d")
        finite = np.where(np.isfinite(value), value, np.nan)
        drawn = axes.scatter(*at_mm.T, c=finite, cmap="viridis", s=30, edgecolors="0.6", linewidths=0.3)
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.set_box_aspect(np.maximum(np.ptp(at_mm, axis=0), 1.0))
        figure.colorbar(drawn, ax=axes, shrink=0.7)
    return figure
