"""Pictures of a calibration: misfits of presses, and what a further press would tell."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.report.figures import blank, colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def misfits(
    reading: Float[np.ndarray, "s k"],
    before: Float[np.ndarray, "s k"],
    after: Float[np.ndarray, "s k"],
    names: Sequence[str],
    unit: str,
) -> "Figure":
    """Measured minus modelled readings of s samples over the measured ones, before and after a fit, all in a
    unit.
    """
    figure = blank(9, 3.4)
    for axes, misfit, title in zip(
        figure.subplots(1, 2, sharey=True),
        (before, after),
        ("before", "after"),
        strict=True,
    ):
        for k, name in enumerate(names):
            axes.plot(reading[:, k], misfit[:, k], ".", color=colour(k), label=name)
        axes.axhline(0.0, color="0.6", lw=0.8)
        axes.set(title=title, xlabel=f"measured [{unit}]")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel(f"measured minus modelled [{unit}]")
    figure.axes[1].legend(title="cavity", fontsize="small")
    return figure


def usefulness(place_mm: Float[np.ndarray, "s 2"], gain: Float[np.ndarray, " s"]) -> "Figure":
    """What one more press at each of s places would tell [nat], seen from above."""
    figure = blank(4.6, 4)
    axes = figure.subplots()
    drawn = axes.scatter(*place_mm.T, c=gain, s=260, marker="s", cmap="viridis")
    axes.plot(*place_mm[np.argmax(gain)], "+", color="white", ms=12)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    figure.colorbar(drawn, ax=axes, label="gain [nat]")
    return figure
