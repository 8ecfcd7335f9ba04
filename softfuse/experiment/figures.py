"""Pictures of an estimated recording, in mm, N and mm³; each function draws one matplotlib figure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from softfuse.experiment.accuracy import NINETY, WORKSPACE_CIRCLE_M, Samples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ESTIMATE, TRUTH = "tab:blue", "0.35"


def blank(width: float, height: float) -> "Figure":
    """An empty figure of width and height [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=110)


def force_over_time(
    time_s: Float[np.ndarray, " n"],
    force_N: Float[np.ndarray, " n"],
    true_force_N: Float[np.ndarray, " n"] | None,
) -> "Figure":
    """Estimated force over time, and the true one where it is known."""
    figure = blank(9, 2.8)
    axes = figure.subplots()
    if true_force_N is not None:
        axes.plot(time_s, true_force_N, color=TRUTH, lw=2.5, alpha=0.6, label="true")
    axes.plot(time_s, force_N, color=ESTIMATE, lw=1, label="estimated")
    axes.set(xlabel="time [s]", ylabel="normal force [N]")
    axes.legend(loc="upper right")
    axes.grid(alpha=0.3)
    return figure


def colour(k: int) -> str:
    """The colour of the k-th of some things."""
    return f"C{k % 10}"


def measured_and_modelled(
    axes: "Axes",
    time_s: Float[np.ndarray, " n"],
    measured: Float[np.ndarray, "n k"],
    misfit: Float[np.ndarray, "n k"],
    names: Sequence[str],
) -> None:
    """Draw k measured readings over time as wide pale lines, those of the model as thin ones."""
    for k, name in enumerate(names):
        axes.plot(time_s, measured[:, k], lw=2.5, alpha=0.4, color=colour(k), label=name)
        axes.plot(time_s, measured[:, k] - misfit[:, k], lw=1, color=colour(k))
    axes.set(title="wide: measured, thin: model")


def volumes_over_time(
    time_s: Float[np.ndarray, " n"],
    measured_mm3: Float[np.ndarray, "n k"],
    misfit_mm3: Float[np.ndarray, "n k"],
    names: Sequence[str],
) -> "Figure":
    """Measured volume changes over time and what the model with the estimated force makes of them."""
    figure = blank(9, 3.2)
    axes = figure.subplots()
    measured_and_modelled(axes, time_s, measured_mm3, misfit_mm3, [f"cavity {name}" for name in names])
    axes.set(xlabel="time [s]", ylabel="volume change [mm³]")
    axes.legend(loc="lower right", ncols=2, fontsize="small")
    axes.grid(alpha=0.3)
    return figure


def drift_over_time(
    time_s: Float[np.ndarray, " n"],
    drift_mm3: Float[np.ndarray, "n k"],
    sigma_mm3: Float[np.ndarray, "n k"],
    names: Sequence[str],
) -> "Figure":
    """What k volumes drift by over time, with bands that hold 90 %."""
    figure = blank(9, 2.8)
    axes = figure.subplots()
    for k, name in enumerate(names):
        axes.plot(time_s, drift_mm3[:, k], lw=1, color=colour(k), label=f"cavity {name}")
        low, high = (drift_mm3[:, k] + side * NINETY * sigma_mm3[:, k] for side in (-1, 1))
        axes.fill_between(time_s, low, high, color=colour(k), alpha=0.2, lw=0)
    axes.set(xlabel="time [s]", ylabel="drift [mm³]")
    axes.legend(loc="lower left", ncols=2, fontsize="small")
    axes.grid(alpha=0.3)
    return figure


def location_map(
    location_mm: Float[np.ndarray, "n 2"],
    samples: Samples | None,
    cavity_outlines_mm: Sequence[Float[np.ndarray, "c 2"]],
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
        axes.plot(*true.T, "+", color=TRUTH, ms=11, label="true")
        axes.plot(*found.T, ".", color="tab:red", ms=4, label="estimated")
        for a, b in zip(true, found, strict=True):
            axes.plot([a[0], b[0]], [a[1], b[1]], color="tab:red", lw=0.8)
        turn = np.linspace(0, 2 * np.pi, 100)
        radius = 1e3 * WORKSPACE_CIRCLE_M
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), ":", color="0.5", lw=1)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    figure.legend(loc="outside upper center", ncols=3, fontsize="small")
    return figure


def force_agreement(samples: Samples, workspace_mm: Float[np.ndarray, "2 2"]) -> "Figure":
    """Estimated over true force, and the relative error at each true location (paper, Fig. 10).

    `workspace_mm` (2, 2): low and high ends of x and y between which contacts may be.
    """
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
    margin = 3.0
    (x0, y0), (x1, y1) = workspace_mm + np.array([[-margin], [margin]])
    right.set(xlabel="x [mm] (levels side by side)", ylabel="y [mm]", aspect="equal")
    right.set(xlim=(x0, x1), ylim=(y0, y1))
    return figure


def electrode_image(image: Float[np.ndarray, "c r"], x_mm: np.ndarray, y_mm: np.ndarray) -> "Figure":
    """The capacitive image s_col ⊗ s_row, at most 1, over the lines' positions [mm]."""
    figure = blank(4.2, 3.6)
    axes = figure.subplots()
    shown = axes.pcolormesh(x_mm, y_mm, image.T / np.max(image), cmap="viridis", shading="nearest")
    figure.colorbar(shown, ax=axes, label="signal / largest")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    return figure


def deformed_shape(
    rest_m: Float[np.ndarray, "p 3"],
    displacement_m: Float[np.ndarray, "p 3"],
    faces: Int[np.ndarray, "f 3"],
) -> "Figure":
    """Outer surface in its deformed shape, true to scale, coloured by how far each face has moved."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure = blank(6.4, 4.2)
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    moved = 1e3 * np.linalg.norm(displacement_m, axis=1)[faces].mean(axis=1)
    scale = Normalize(0, max(float(moved.max(initial=0.0)), 1e-3))
    corners = 1e3 * (rest_m + displacement_m)[faces]
    colours = colormaps["viridis"](scale(moved))
    axes.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors="0.35", linewidths=0.15))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.set_box_aspect(high - low)
    axes.view_init(elev=38, azim=-60)
    axes.set(zticks=[round(float(low[2])), round(float(high[2]))])
    figure.colorbar(
        ScalarMappable(scale, "viridis"), ax=axes, label="displacement [mm]", shrink=0.7, pad=0.12
    )
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
