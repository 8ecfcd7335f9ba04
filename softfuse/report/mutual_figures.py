"""Images of a grid of mutual capacitances under what hovers and presses: Fig. 11 of Navarro et al. 2020."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.report.figures import blank
from softfuse.sensors.mutual.field import Thing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ONE, _OTHER = (-8e-3, 8e-3), (8e-3, -8e-3)

FIG_11: Mapping[str, tuple[Thing, ...]] = {
    "proximity, 5 mm": (Thing(_ONE, distance=5e-3),),
    "light touch": (Thing(_ONE),),
    "firm touch, 6 N": (Thing(_ONE, force=6.0),),
    "not conductive, 4 N": (Thing(_ONE, force=4.0, permittivity=3.0),),
    "two touches, 0 N and 6 N": (Thing(_ONE), Thing(_OTHER, force=6.0)),
}
"""What the paper shows: near, light and firm, what does not conduct, and two at once."""


def image_of(bed: MutualBed, things: Sequence[Thing], rest_s: float = 1.0) -> Float[np.ndarray, "c r"]:
    """Counts (c, r) under some things above their mean in a rest of rest_s [s] before, at 100 Hz."""
    time = 0.01 * np.arange(int(round(100 * rest_s)) + 1)
    change = np.zeros((len(time), len(bed.field.column_x), len(bed.field.row_y)))
    change[-1] = bed.field.change(things)
    counts = bed.counts_of(time, change)
    signal = counts[-1] - counts[:-1].mean(axis=0)
    return signal.reshape(len(bed.field.row_y), len(bed.field.column_x)).T


def fig_11(bed: MutualBed, cases: Mapping[str, Sequence[Thing]] = FIG_11) -> "Figure":
    """The images of some cases from a virtual array, with circles where the things are."""
    images = {name: image_of(bed, things) for name, things in cases.items()}
    return signed_images(images, 1e3 * np.array(bed.field.column_x), 1e3 * np.array(bed.field.row_y), cases)


def signed_images(
    images: Mapping[str, Float[np.ndarray, "c r"]],
    x_mm: Float[np.ndarray, " c"],
    y_mm: Float[np.ndarray, " r"],
    cases: Mapping[str, Sequence[Thing]],
) -> "Figure":
    """Images (c, r) of counts by name, on one scale over lines at x_mm (c,), y_mm (r,), and the things."""
    from matplotlib.patches import Circle

    figure = blank(max(2.6 * len(images), 4.2), 3.2)
    every = figure.subplots(1, len(images), sharey=True, squeeze=False)[0]
    largest = max(np.max(np.abs(image)) for image in images.values()) or 1.0
    for axes, (name, image) in zip(every, images.items(), strict=True):
        shown = axes.pcolormesh(
            x_mm, y_mm, image.T, cmap="RdBu_r", vmin=-largest, vmax=largest, shading="nearest"
        )
        for (i, j), value in np.ndenumerate(image):
            dark = abs(value) > 0.6 * largest
            colour = "white" if dark else "0.2"
            axes.text(x_mm[i], y_mm[j], f"{value:.0f}", ha="center", va="center", fontsize=7, color=colour)
        for thing in cases.get(name, ()):
            x, y = (1e3 * p for p in thing.place)
            axes.add_patch(Circle((x, y), 1e3 * thing.radius, fill=False, ls="--", lw=1, color="0.3"))
        axes.set_title(name, fontsize=9)
        axes.set(xlabel="x [mm]", aspect="equal")
    every[0].set_ylabel("y [mm]")
    figure.colorbar(shown, ax=list(every), label="change [counts]", shrink=0.8)
    return figure
