"""What `softfuse evaluate` says of presses and pushes: Tables I to III and Figures 9 to 13 of Navarro et al.
2020.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from softfuse.experiment.accuracy import (
    PULLED_M,
    ContactSamples,
    Samples,
    ShapeSamples,
    contact_force_table,
    coverage,
    force_table,
    location_table,
    position_table,
    scaled,
    together,
)
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.experiment.paper.reported import FORCE_ERROR_PERCENT, LOCATION_ERROR_MM, POSITION_ERROR_MM
from softfuse.experiment.pose_cache import Arrays
from softfuse.mesh.surface import outer_surface
from softfuse.report import figures, shape_figures
from softfuse.report.evaluation import Comparison, Evaluation, Evaluator, Plate
from softfuse.report.figures import blank
from softfuse.report.page import table
from softfuse.report.sections import chamber_outlines, largest_shapes
from softfuse.report.shape_figures import Shape
from softfuse.report.study import Study
from softfuse.robot.robot import Robot
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

_SAMPLES = [each.name for each in fields(Samples)]
_PARTS: Mapping[str, type] = {"shape": ShapeSamples, "contact": ContactSamples, "largest": Shape}


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


def _of_presses(study: Study) -> Arrays:
    """The samples of a press."""
    samples = study.samples
    assert samples is not None  # the test bed knows
    return {name: getattr(samples, name) for name in _SAMPLES}


def _presses_evaluated(robot: Robot, found: Mapping[str, Sequence[Arrays]]) -> Evaluation:
    """The evaluation of presses, each estimated in some ways."""
    samples = {way: together([Samples(**each) for each in many]) for way, many in found.items()}
    named = _named_forces(next(iter(samples.values())))
    location = {way: scaled(location_table(each), 1e3) for way, each in samples.items()}
    force = {way: scaled(force_table(each), 100.0) for way, each in samples.items()}
    tables = (
        Comparison("table_1", "Table I: location error", "mm", LOCATION_ERROR_MM, location, named),
        Comparison("table_2", "Table II: force error", "%", FORCE_ERROR_PERCENT, force, named),
    )
    outlines, plates = chamber_outlines(robot), []
    for way, each in samples.items():
        key = way.replace(" ", "_")
        places = np.empty((0, 2))
        plates += [
            Plate(
                f"figure_09_{key}",
                f"Figure 9, {way}: true and estimated locations over the chambers.",
                figures.location_map(places, each, outlines),
            ),
            Plate(
                f"figure_10_{key}",
                f"Figure 10, {way}: estimated over true force, and the force error at the true locations.",
                figures.force_agreement(each),
            ),
        ]
    caption = "Figure 11: what a grid of 4 x 4 mutual capacitances sees of things near and touching."
    plates.append(Plate("figure_11", caption, fig_11(MutualBed())))
    return Evaluation(tables, tuple(plates), (("90 % intervals", _intervals(samples)),), _press_rows(samples))


def _named_forces(samples: Samples) -> dict[str, str]:
    """What to call the groups of samples: levels by their forces."""
    levels = {
        f"level_{k}": f"{np.mean(samples.true_force_N[samples.level == k]):.3g} N"
        for k in np.unique(samples.level)
    }
    return {"all": "all", "circle": "within 28 mm of the middle"} | levels


def _intervals(samples: Mapping[str, Samples]) -> str:
    inside = {way: coverage(each) for way, each in samples.items()}
    rows = [
        (name, *(f"{100 * part[name]:.0f} %" for part in inside.values())) for name in ("force", "x", "y")
    ]
    return "<p>In so many samples the truth lies within the 90 % interval of the estimate:</p>" + table(
        ("", *inside), rows
    )


def _press_rows(samples: Mapping[str, Samples]) -> dict[str, dict[str, np.ndarray]]:
    """Columns of a table of all samples, of each way."""
    return {
        way: {
            "level": each.level,
            "true_x_mm": 1e3 * each.true_location_m[:, 0],
            "true_y_mm": 1e3 * each.true_location_m[:, 1],
            "true_force_N": each.true_force_N,
            "x_mm": 1e3 * each.location_m[:, 0],
            "y_mm": 1e3 * each.location_m[:, 1],
            "force_N": each.force_N,
            "x_sigma_mm": 1e3 * each.location_sigma_m[:, 0],
            "y_sigma_mm": 1e3 * each.location_sigma_m[:, 1],
            "force_sigma_N": each.force_sigma_N,
        }
        for way, each in samples.items()
    }


PRESSES = Evaluator(frozenset(_SAMPLES), _of_presses, _presses_evaluated)
"""Tables I and II, Figures 9 to 11."""


@dataclass(frozen=True, eq=False)
class Pushed:
    """What is kept of a push: its samples, the depth (s,) m of each, the shape under its largest force."""

    shape: ShapeSamples
    contact: ContactSamples
    depth_m: Float[np.ndarray, " s"]
    largest: Shape

    @property
    def arrays(self) -> Arrays:
        """As it is kept; read again by `of`."""
        return {"depth_m": self.depth_m} | {
            f"{part}.{each.name}": np.asarray(getattr(getattr(self, part), each.name))
            for part, kind in _PARTS.items()
            for each in fields(kind)
        }

    @classmethod
    def of(cls, arrays: Arrays) -> "Pushed":
        """As it was kept."""

        def part(name: str, kind: type):
            return kind(**{each.name: arrays[f"{name}.{each.name}"] for each in fields(kind)})

        return cls(**{name: part(name, kind) for name, kind in _PARTS.items()}, depth_m=arrays["depth_m"])


def _of_pushes(study: Study) -> Arrays:
    """What is kept of a push."""
    shape, contact, depth_mm = study.shape_samples, study.contact_samples, study.truth.depth_mm
    assert shape is not None and contact is not None and depth_mm is not None  # the test bed knows
    depth = 1e-3 * depth_mm[study.truth.samples(study.point_columns)]
    return Pushed(shape, contact, depth, largest_shapes(study)[0]).arrays


def _pushes_evaluated(robot: Robot, found: Mapping[str, Sequence[Arrays]]) -> Evaluation:
    """The evaluation of pushes, each estimated in some ways."""
    pushes = {way: [Pushed.of(each) for each in many] for way, many in found.items()}
    names = [point.name for point in robot.settings.points]
    shapes = {way: together([each.shape for each in many]) for way, many in pushes.items()}
    contacts = {way: together([each.contact for each in many]) for way, many in pushes.items()}
    position = {way: scaled(position_table(each, names), 1e3) for way, each in shapes.items()}
    force = {way: scaled(contact_force_table(each), 100.0) for way, each in contacts.items()}
    named = _named_depths(next(iter(pushes.values())))
    tables = (
        Comparison("table_3", "Table III: position error", "mm", POSITION_ERROR_MM, position, named),
        Comparison("forces", "Force error", "%", {}, force, named),
    )
    rest = np.array([point.at for point in robot.settings.points])
    mesh = robot.mesh.mesh
    flat = figures.flat_triangles(outer_surface(mesh).faces)
    plates = []
    for way, each in shapes.items():
        depth = np.concatenate([push.depth_m for push in pushes[way]])
        moved = figures.points_over_depth(
            each.press,
            1e3 * depth,
            each.cable_m > PULLED_M,
            1e3 * (each.position_m - rest),
            1e3 * (each.true_position_m - rest),
            names,
            "depth [mm]",
        )
        seen = [push.largest for push in pushes[way]]
        plates += [
            Plate("figure_12", "Figure 12: how far points of the body have moved, over depth.", moved),
            Plate(
                "figure_13",
                "Figure 13: the estimated body under the largest force of each push, over its rest.",
                shape_figures.shapes(mesh.nodes, flat, seen),
            ),
        ]
    return Evaluation(
        tables, tuple(plates), (), {way: _push_rows(each, names) for way, each in shapes.items()}
    )


def _named_depths(pushes: Sequence[Pushed]) -> dict[str, str]:
    """What to call the groups of samples: levels by their depths."""
    level = np.concatenate([push.shape.level for push in pushes])
    depth = np.concatenate([push.depth_m for push in pushes])
    levels = {f"level_{k}": f"{1e3 * np.mean(depth[level == k]):.3g} mm" for k in np.unique(level)}
    return {"with_cable": "with cable", "without_cable": "without cable"} | levels


def _push_rows(samples: ShapeSamples, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of a table of all samples."""
    columns = {"press": samples.press, "level": samples.level, "cable_mm": 1e3 * samples.cable_m}
    for k, name in enumerate(names):
        for i, axis in enumerate("xyz"):
            columns[f"{name}_{axis}_mm"] = 1e3 * samples.position_m[:, k, i]
            columns[f"true_{name}_{axis}_mm"] = 1e3 * samples.true_position_m[:, k, i]
    return columns


PUSHES = Evaluator(
    frozenset(
        {"depth_m"} | {f"{part}.{each.name}" for part, kind in _PARTS.items() for each in fields(kind)}
    ),
    _of_pushes,
    _pushes_evaluated,
)
"""Table III, Figures 12 and 13."""
