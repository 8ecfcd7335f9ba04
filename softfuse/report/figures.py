"""Pictures of an estimated recording, in people's units; each function draws one matplotlib figure. Wide pale
lines are true or measured, thin ones estimated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.experiment.accuracy import NINETY, Samples
from softfuse.sensors.base import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ESTIMATE, TRUTH = "tab:blue", "0.35"


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes over time: what they show, with its unit; k named lines (n, k), and what is measured or true
    beneath them (n, k), if anything; NaN where it is not known.
    """

    label: str
    names: Sequence[str]
    estimated: Float[np.ndarray, "n k"]
    beneath: Float[np.ndarray, "n k"] | None = None


def blank(width: float, height: float) -> "Figure":
    """An empty figure of width and height [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=110)


def colour(k: int) -> str:
    """The colour of the k-th of some things."""
    return f"C{k % 10}"


def over_time(time_s: Float[np.ndarray, " n"], panels: Sequence[Panel], beneath: str = "true") -> "Figure":
    """Panels one below the other; `beneath`: what their wide lines are."""
    figure = blank(9, 1.0 + 2.2 * len(panels))
    every = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(every, panels, strict=True):
        for k, name in enumerate(panel.names):
            if panel.beneath is not None:
                axes.plot(time_s, panel.beneath[:, k], lw=2.8, alpha=0.4, color=colour(k))
            axes.plot(time_s, panel.estimated[:, k], ".-", lw=1, ms=1.5, color=colour(k), label=name)
        axes.set(ylabel=panel.label)
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small")
    if any(panel.beneath is not None for panel in panels):
        every[0].set(title=f"wide: {beneath}, thin: estimated")
    every[-1].set(xlabel="time [s]")
    return figure


def drift_over_time(
    time_s: Float[np.ndarray, " n"],
    drift: Float[np.ndarray, "n k"],
    sigma: Float[np.ndarray, "n k"],
    names: Sequence[str],
    unit: str,
) -> "Figure":
    """What k readings drift by over time, in a unit, with bands that hold 90 %."""
    figure = over_time(time_s, [Panel(f"drift [{unit}]", names, drift)])
    axes = figure.axes[0]
    for k in range(len(names)):
        low, high = (drift[:, k] + side * NINETY * sigma[:, k] for side in (-1, 1))
        axes.fill_between(time_s, low, high, color=colour(k), alpha=0.2, lw=0)
    return figure


def location_map(
    location_mm: Float[np.ndarray, "n 2"],
    samples: Samples | None,
    cavity_outlines_mm: Sequence[Float[np.ndarray, "_ 2"]],
) -> "Figure":
    """Estimated locations of all frames seen from above; at the samples, lines lead to the truth."""
    figure = blank(5.2, 5)
    axes = figure.subplots()
    for outline in cavity_outlines_mm:
        axes.fill(*outline.T, color="0.93", ec="0.7", zorder=0)
    if len(location_mm):
        axes.plot(*location_mm.T, ".", ms=2, alpha=0.25, color=ESTIMATE, label="every frame")
    if samples is not None:
        true, found = 1e3 * samples.true_location_m, 1e3 * samples.location_m
        axes.plot(*true[:, :2].T, "+", color=TRUTH, ms=11, label="true")
        axes.plot(*found[:, :2].T, ".", color="tab:red", ms=4, label="estimated")
        for a, b in zip(true, found, strict=True):
            axes.plot([a[0], b[0]], [a[1], b[1]], color="tab:red", lw=0.8)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    figure.legend(loc="outside upper center", ncols=3, fontsize="small")
    return figure


def force_agreement(samples: Samples) -> "Figure":
    """Estimated over true force, and the relative error at each true location (paper, Fig. 10)."""
    figure = blank(9, 4)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    top = 1.1 * np.nanmax([samples.true_force_N, samples.force_N])
    left.plot([0, top], [0, top], color=TRUTH, lw=1)
    left.plot(samples.true_force_N, samples.force_N, ".", color=ESTIMATE)
    left.set(xlabel="true force [N]", ylabel="estimated force [N]", xlim=(0, top), ylim=(0, top))
    left.grid(alpha=0.3)
    error = 100 * (samples.force_N / samples.true_force_N - 1)
    bound = max(1.0, float(np.nanmax(np.abs(error), initial=0.0)))
    # The levels of one place side by side.
    shift = 1.2 * (samples.level - np.mean(np.unique(samples.level)))
    dots = right.scatter(
        1e3 * samples.true_location_m[:, 0] + shift,
        1e3 * samples.true_location_m[:, 1],
        c=error,
        cmap="coolwarm",
        vmin=-bound,
        vmax=bound,
        s=28,
        edgecolors="0.5",
        linewidths=0.3,
    )
    figure.colorbar(dots, ax=right, label="force error [%]")
    right.set(xlabel="x [mm] (levels side by side)", ylabel="y [mm]", aspect="equal")
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
    for axes in grid.ravel():
        axes.grid(alpha=0.3)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize="small")
    figure.suptitle("lines: true (dashed with cable), marks: estimated", fontsize="medium")
    return figure


def electrode_image(image: Image) -> "Figure":
    """What electrodes see, over their largest signal; blue for shielding, red for coupling where both are."""
    figure = blank(4.2, 3.6)
    axes = figure.subplots()
    largest = np.max(np.abs(image.values)) or 1.0
    signed = np.min(image.values) < -0.05 * largest
    shown = axes.pcolormesh(
        1e3 * image.x_m,
        1e3 * image.y_m,
        image.values / largest,
        cmap="RdBu_r" if signed else "viridis",
        vmin=-1.0 if signed else 0.0,
        vmax=1.0,
        shading="nearest",
    )
    figure.colorbar(shown, ax=axes, label="signal / largest")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    return figure


def latencies(latency_ms: Float[np.ndarray, " n"]) -> "Figure":
    """How long the frames with a contact took."""
    figure = blank(5, 2.6)
    axes = figure.subplots()
    axes.hist(latency_ms, bins=60, range=(0, np.quantile(latency_ms, 0.995)), color=ESTIMATE)
    axes.set(xlabel="latency [ms]", ylabel="frames")
    return figure


def flat_triangles(faces: Int[np.ndarray, "f s"]) -> Int[np.ndarray, "t 3"]:
    """The faces (f, 3) themselves, or four flat triangles for each of quadratic ones (f, 6)."""
    if faces.shape[1] == 3:
        return faces
    a, b, c, ab, bc, ca = faces.T
    return np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )


def misfits(
    reading: Float[np.ndarray, "s k"],
    before: Float[np.ndarray, "s k"],
    after: Float[np.ndarray, "s k"],
    names: Sequence[str],
    unit: str,
) -> "Figure":
    """Measured minus modelled readings of s samples over measured ones, before and after a fit, in a unit."""
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


def maps(
    x_mm: Float[np.ndarray, " a"],
    y_mm: Float[np.ndarray, " b"],
    values: dict[str, Float[np.ndarray, "a b"]],
) -> "Figure":
    """One map for each of the values (a, b), by title, over x (a,) and y (b,); what is infinite is white."""
    figure = blank(4.6 * len(values), 3.9)
    for axes, (title, value) in zip(np.ravel(figure.subplots(1, len(values))), values.items(), strict=True):
        finite = np.where(np.isfinite(value), value, np.nan)
        drawn = axes.pcolormesh(x_mm, y_mm, finite.T, shading="nearest", cmap="viridis")
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
        figure.colorbar(drawn, ax=axes)
    return figure


def spots(at_mm: Float[np.ndarray, "s 3"], values: dict[str, Float[np.ndarray, " s"]]) -> "Figure":
    """Places (s, 3) of a surface, a picture for each of the values (s,), by title; infinite ones white."""
    figure = blank(4.6 * len(values), 4.2)
    for k, (title, value) in enumerate(values.items(), start=1):
        axes = figure.add_subplot(1, len(values), k, projection="3d")
        finite = np.where(np.isfinite(value), value, np.nan)
        drawn = axes.scatter(*at_mm.T, c=finite, cmap="viridis", s=30, edgecolors="0.6", linewidths=0.3)
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.set_box_aspect(np.maximum(np.ptp(at_mm, axis=0), 1.0))
        figure.colorbar(drawn, ax=axes, shrink=0.7)
    return figure


def tried(searches: Mapping[str, Float[np.ndarray, " n"]], name: str, before: float) -> "Figure":
    """The objective, called `name`, of each trial (n,) of each search, NaN where a mesh was worn, over its
    number; and that of the robot as it is.
    """
    figure = blank(8, 3.2)
    axes = figure.subplots()
    axes.axhline(before, color=TRUTH, lw=1, ls="--", label="robot as it is")
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
    before_mm: Sequence[Float[np.ndarray, "_ 3"]],
    after_mm: Sequence[Float[np.ndarray, "_ 3"]],
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
