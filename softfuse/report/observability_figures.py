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
