"""Pictures of a finger's estimated recording over time and over the depth of its pushes, in mm, N, kPa, deg;
each function draws one matplotlib figure. Wide grey or pale lines are measured or true, thin ones estimated.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.experiment.figures import TRUTH, blank, colour, measured_and_modelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def pressures_over_time(
    time_s: Float[np.ndarray, " n"],
    measured_kPa: Float[np.ndarray, "n k"],
    misfit_kPa: Float[np.ndarray, "n k"],
    names: Sequence[str],
) -> "Figure":
    """Measured gauge pressures and those of the model; below, how much they differ."""
    figure = blank(9, 4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    measured_and_modelled(above, time_s, measured_kPa, misfit_kPa, names)
    for k in range(len(names)):
        below.plot(time_s, misfit_kPa[:, k], lw=1, color=colour(k))
    above.set(ylabel="gauge pressure [kPa]")
    below.set(xlabel="time [s]", ylabel="misfit [kPa]")
    _legend(above)
    _grid(above, below)
    return figure


def cables_over_time(
    time_s: Float[np.ndarray, " n"],
    measured_mm: Float[np.ndarray, "n b"],
    shortening_mm: Float[np.ndarray, "n b"],
    tension_N: Float[np.ndarray, "n b"],
    true_N: Float[np.ndarray, "n b"],
    names: Sequence[str],
) -> "Figure":
    """Shortening and tension of b cables; measured and true values are NaN where they are not known."""
    figure = blank(9, 4.2)
    above, below = figure.subplots(2, 1, sharex=True)
    for k, name in enumerate(names):
        above.plot(time_s, measured_mm[:, k], lw=2.5, alpha=0.4, color=colour(k))
        above.plot(time_s, shortening_mm[:, k], lw=1, color=colour(k), label=name)
        below.plot(time_s, true_N[:, k], lw=2.5, alpha=0.6, color=TRUTH)
        below.plot(time_s, tension_N[:, k], lw=1, color=colour(k))
    above.set(ylabel="shortening [mm]", title="wide: measured, below true; thin: estimated")
    below.set(xlabel="time [s]", ylabel="tension [N]")
    _legend(above)
    _grid(above, below)
    return figure


def contacts_over_time(
    time_s: Float[np.ndarray, " n"],
    force_N: Float[np.ndarray, "n e"],
    true_force_N: Float[np.ndarray, "n e"],
    names: Sequence[str],
) -> "Figure":
    """Forces on e electrodes, estimated and true, NaN where nothing presses or it is not known."""
    figure = blank(9, 3.2)
    axes = figure.subplots()
    for k, name in enumerate(names):
        axes.plot(time_s, true_force_N[:, k], lw=3, alpha=0.35, color=colour(k))
        axes.plot(time_s, force_N[:, k], ".-", lw=1, ms=2, color=colour(k), label=name)
    axes.set(xlabel="time [s]", ylabel="normal force [N]", title="wide: true, thin: estimated")
    if len(names):
        _legend(axes)
    _grid(axes)
    return figure


def bending_over_time(
    time_s: Float[np.ndarray, " n"], turn_deg: Float[np.ndarray, "n l"], tip_deg: Float[np.ndarray, " n"]
) -> "Figure":
    """Bending of each of l segments of the centreline from the base to the tip, and that of the tip."""
    figure = blank(9, 3.2)
    axes = figure.subplots()
    for k in range(turn_deg.shape[1]):
        axes.plot(time_s, turn_deg[:, k], lw=1, color=colour(k), label=f"segment {k}")
    axes.plot(time_s, tip_deg, "--", lw=1, color=TRUTH, label="tip against rest")
    axes.set(xlabel="time [s]", ylabel="bending [deg]")
    _legend(axes)
    _grid(axes)
    return figure


def points_over_time(
    time_s: Float[np.ndarray, " n"],
    moved_mm: Float[np.ndarray, "n p 3"],
    true_mm: Float[np.ndarray, "n p 3"] | None,
    names: Sequence[str],
) -> "Figure":
    """How far p points have moved along x, y, z; estimated, and true where it is known."""
    figure = blank(9, 6)
    rows = figure.subplots(3, 1, sharex=True)
    for axis, axes in enumerate(rows):
        for k, name in enumerate(names):
            if true_mm is not None:
                axes.plot(time_s, true_mm[:, k, axis], lw=3, alpha=0.35, color=colour(k))
            axes.plot(time_s, moved_mm[:, k, axis], lw=1, color=colour(k), label=name)
        axes.set(ylabel=f"moved along {'xyz'[axis]} [mm]")
    title = "thin: estimated" if true_mm is None else "wide: true, thin: estimated"
    rows[0].set(title=title)
    _legend(rows[0])
    rows[-1].set(xlabel="time [s]")
    _grid(*rows)
    return figure


def points_over_depth(
    press: Int[np.ndarray, " s"],
    depth: Float[np.ndarray, " s"],
    pulled: Bool[np.ndarray, " s"],
    moved_mm: Float[np.ndarray, "s p 3"],
    true_mm: Float[np.ndarray, "s p 3"],
    names: Sequence[str],
    depth_name: str,
) -> "Figure":
    """How far p points have moved at the samples (s,) of each push: true lines, estimated dots; with and
    without a pulled cable (paper, Fig. 12).
    """
    figure = blank(2.6 * max(len(names), 2) + 0.8, 6.6)
    grid = figure.subplots(3, len(names), sharex=True, squeeze=False)
    markers = "osD^v<>p"
    for j, push in enumerate(np.unique(press)):
        rows = press == push
        cable = bool(pulled[rows].any())
        marker = markers[j % len(markers)]
        label = f"push {push}, {'with' if cable else 'without'} cable"
        for k, name in enumerate(names):
            for axis in range(3):
                axes, line = grid[axis, k], "--" if cable else "-"
                true, found = true_mm[rows, k, axis], moved_mm[rows, k, axis]
                axes.plot(depth[rows], true, line, lw=1.5, color=colour(j))
                axes.plot(depth[rows], found, marker, ms=5, mfc="none", color=colour(j), label=label)
                axes.set(title=name if axis == 0 else None, xlabel=depth_name if axis == 2 else None)
                axes.set(ylabel=f"moved along {'xyz'[axis]} [mm]" if k == 0 else None)
    _grid(*grid.ravel())
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize="small")
    figure.suptitle("lines: true (dashed with cable), marks: estimated", fontsize="medium")
    return figure


def _legend(axes: "Axes") -> None:
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small")


def _grid(*many: "Axes") -> None:
    for axes in many:
        axes.grid(alpha=0.3)
