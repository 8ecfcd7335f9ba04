"""The evaluation of Navarro et al. 2020 of any robot that their test bed can press: what is kept of each
recording, and the tables and figures of all of them.

Tables I and II and Figures 9 and 10 where contacts may be anywhere, Table III and Figures 12 and 13 where
points are followed, forces at places with names where these are pressed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from queue import SimpleQueue

import numpy as np
from jaxtyping import Float

from softfuse.estimation.side_by_side import cores
from softfuse.estimation.stream import follow
from softfuse.estimation.tracker import Tracker
from softfuse.experiment.accuracy import Samples, coverage, force_table, location_table, scaled, together
from softfuse.experiment.contact_accuracy import ContactSamples, contact_force_table
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.experiment.paper.reported import FORCE_ERROR_PERCENT, LOCATION_ERROR_MM, POSITION_ERROR_MM
from softfuse.experiment.pose_cache import Arrays, kept
from softfuse.experiment.shape_accuracy import PULLED_M, ShapeSamples, position_table
from softfuse.mesh.surface import outer_surface
from softfuse.report import figures, shape_figures
from softfuse.report.comparison import Comparison
from softfuse.report.evaluation_page import Evaluation, Plate
from softfuse.report.mutual_figures import fig_11
from softfuse.report.page import table
from softfuse.report.recorded import Part, read_sensors, sensor_frames
from softfuse.report.recording_report import EstimateRows
from softfuse.report.sections import chamber_outlines_mm, largest_shapes
from softfuse.report.shape_figures import Shape
from softfuse.report.study import Study
from softfuse.robot.robot import Robot

EVERY = 10
"""Frames from one estimate to the next: ten estimates a second, which a full body manages live."""

_KINDS: Mapping[str, type] = {
    "samples": Samples,
    "shape": ShapeSamples,
    "contact": ContactSamples,
    "largest": Shape,
}


@dataclass(frozen=True, eq=False)
class Pushed:
    """What is kept of a recording, as far as there is such: samples of contacts anywhere, of points, of
    contacts at places with names; the depth (s,) m of those of points; the shape under the largest force.
    """

    samples: Samples | None = None
    shape: ShapeSamples | None = None
    contact: ContactSamples | None = None
    largest: Shape | None = None
    depth_m: Float[np.ndarray, " s"] | None = None

    @classmethod
    def said(cls, study: Study) -> "Pushed":
        """Of a study that has seen all."""
        depth, shown = study.truth.depth_mm, largest_shapes(study)
        at = study.truth.samples(study.point_columns)
        return cls(
            study.samples,
            study.shape_samples,
            study.contact_samples,
            shown[0] if shown and study.shape_samples is not None else None,
            None if depth is None or not at.size else 1e-3 * depth[at],
        )

    @property
    def arrays(self) -> Arrays:
        """As it is kept; read again by `of`."""
        parts = {name: part for name in _KINDS if (part := getattr(self, name)) is not None}
        arrays = {
            f"{name}.{each.name}": np.asarray(getattr(part, each.name))
            for name, part in parts.items()
            for each in fields(part)
        }
        return {} | arrays | ({} if self.depth_m is None else {"depth_m": self.depth_m})

    @classmethod
    def of(cls, arrays: Arrays) -> "Pushed":
        """As it was kept."""
        parts = {
            name: kind(**{each.name: arrays[f"{name}.{each.name}"] for each in fields(kind)})
            for name, kind in _KINDS.items()
            if any(key.startswith(f"{name}.") for key in arrays)
        }
        return cls(**parts, depth_m=arrays.get("depth_m"))


def estimated(
    robot: Robot, recordings: Sequence[Path], folder: Path, begin: Callable[[int], Callable[[], None]]
) -> list[Pushed]:
    """What is said of each recording of a robot, in their order.

    They are kept in the folder, with the estimates as CSV, and not estimated again where they are there.
    `begin` is called with how many there are; what it returns is called after each.
    """
    files = [path.name.removesuffix(".csv.gz") for path in recordings]
    done = begin(len(files))

    def start() -> Callable[[int], Mapping[str, np.ndarray]]:
        trackers: SimpleQueue[Tracker] = SimpleQueue()
        for _ in range(min(cores(), len(files))):
            trackers.put(Tracker(robot))
        folder.mkdir(parents=True, exist_ok=True)

        def compute(k: int) -> Mapping[str, np.ndarray]:
            whole = read_sensors(robot.settings, recordings[k])
            part = Part.of(whole, EVERY)
            study, tracker = Study(robot, part.recording), trackers.get()
            try:
                tracker.reset()
                frames = zip(sensor_frames(robot.settings, whole), part.estimated, strict=True)
                with (folder / f"{files[k]}.csv").open("w", newline="") as stream:
                    rows = EstimateRows(stream, study)
                    for now in follow(tracker, frames):
                        study.see(now)
                        rows.write()
            finally:  # the others wait for it
                trackers.put(tracker)
            done()
            return Pushed.said(study).arrays

        return compute

    return [Pushed.of(arrays) for arrays in kept(folder, files, _names(robot, recordings), start)]


def _names(robot: Robot, recordings: Sequence[Path]) -> frozenset[str]:
    """The arrays that are kept of each recording: those that a study of the first one would say."""
    study = Study(robot, read_sensors(robot.settings, recordings[0]))
    named, points = bool(study.columns.places), study.truth.samples(study.point_columns).size > 0
    there = {"contact"} if named else {"samples"}
    there |= {"shape", "largest"} if points else set()
    each = {f"{name}.{field.name}" for name in there for field in fields(_KINDS[name])}
    return frozenset(each | ({"depth_m"} if points and study.truth.depth_mm is not None else set()))


def evaluation(robot: Robot, found: Mapping[str, Sequence[Pushed]]) -> Evaluation:
    """The evaluation of recordings, each estimated in some ways."""
    first = next(iter(found.values()))
    evaluations = []
    if first[0].samples is not None:
        evaluations.append(
            _anywhere(robot, {way: together([p.samples for p in many]) for way, many in found.items()})
        )
    if first[0].shape is not None:
        evaluations.append(_points(robot, found))
    if first[0].contact is not None:
        evaluations.append(_at_places(found))
    return Evaluation.joined(evaluations)


def _anywhere(robot: Robot, samples: Mapping[str, Samples]) -> Evaluation:
    """Tables I and II, intervals, Figures 9 to 11."""
    one = next(iter(samples.values()))
    levels = {
        f"level_{k}": f"{np.mean(one.true_force_N[one.level == k]):.3g} N" for k in np.unique(one.level)
    }
    named = {"all": "all", "circle": "within 28 mm of the middle"} | levels
    location = {way: scaled(location_table(each), 1e3) for way, each in samples.items()}
    force = {way: scaled(force_table(each), 100.0) for way, each in samples.items()}
    tables = (
        Comparison("table_1", "Table I: location error", "mm", LOCATION_ERROR_MM, location, named),
        Comparison("table_2", "Table II: force error", "%", FORCE_ERROR_PERCENT, force, named),
    )
    plates = []
    for way, each in samples.items():
        key = way.replace(" ", "_")
        plates += [
            Plate(
                f"figure_09_{key}",
                f"Figure 9, {way}: true and estimated locations over the chambers.",
                figures.location_map(np.empty((0, 2)), each, chamber_outlines_mm(robot)),
            ),
            Plate(
                f"figure_10_{key}",
                f"Figure 10, {way}: estimated over true force, and the force error at the true locations.",
                figures.force_agreement(each),
            ),
        ]
    caption = "Figure 11: what a grid of 4 x 4 mutual capacitances sees of things near and touching."
    plates.append(Plate("figure_11", caption, fig_11(MutualBed())))
    rows = {way: _sample_rows(each) for way, each in samples.items()}
    return Evaluation(tables, tuple(plates), (("90 % intervals", _intervals(samples)),), rows)


def _intervals(samples: Mapping[str, Samples]) -> str:
    inside = {way: coverage(each) for way, each in samples.items()}
    names = next(iter(inside.values()))
    rows = [(name, *(f"{100 * part[name]:.0f} %" for part in inside.values())) for name in names]
    return "<p>In so many samples the truth lies within the 90 % interval of the estimate:</p>" + table(
        ("", *inside), rows
    )


def _sample_rows(each: Samples) -> dict[str, np.ndarray]:
    """Columns of a table of all samples."""
    axes = "xyz"[: each.location_m.shape[1]]
    columns = {"level": each.level}
    columns |= {f"true_{axis}_mm": 1e3 * each.true_location_m[:, k] for k, axis in enumerate(axes)}
    columns["true_force_N"] = each.true_force_N
    columns |= {f"{axis}_mm": 1e3 * each.location_m[:, k] for k, axis in enumerate(axes)}
    columns["force_N"] = each.force_N
    columns |= {f"{axis}_sigma_mm": 1e3 * each.location_sigma_m[:, k] for k, axis in enumerate(axes)}
    return columns | {"force_sigma_N": each.force_sigma_N}


def _points(robot: Robot, found: Mapping[str, Sequence[Pushed]]) -> Evaluation:
    """Table III, Figures 12 and 13."""
    names = [point.name for point in robot.settings.points]
    shapes = {way: together([each.shape for each in many]) for way, many in found.items()}
    position = {way: scaled(position_table(each, names), 1e3) for way, each in shapes.items()}
    title = "Table III: position error"
    tables = (Comparison("table_3", title, "mm", POSITION_ERROR_MM, position, _by_depth(found)),)
    rest = np.array([point.at for point in robot.settings.points])
    mesh = robot.mesh.mesh
    flat = figures.flat_triangles(outer_surface(mesh).faces)
    plates = []
    for way, each in shapes.items():
        depths = [_depth_mm(push) for push in found[way]]
        moved = figures.points_over_depth(
            each.press,
            np.concatenate(depths),
            each.cable_m > PULLED_M,
            1e3 * (each.position_m - rest),
            1e3 * (each.true_position_m - rest),
            names,
            "depth [mm]",
        )
        key = way.replace(" ", "_") if len(shapes) > 1 else ""
        seen = [push.largest for push in found[way] if push.largest is not None]
        plates += [
            Plate(f"figure_12{key}", "Figure 12: how far points have moved, over depth.", moved),
            Plate(
                f"figure_13{key}",
                "Figure 13: the estimated body under the largest force of each push, over its rest.",
                shape_figures.shapes(mesh.nodes, flat, seen),
            ),
        ]
    rows = {way: _point_rows(each, names) for way, each in shapes.items()}
    return Evaluation(tables, tuple(plates), (), rows)


def _depth_mm(push: Pushed) -> np.ndarray:
    """Depths (s,) [mm] of the samples of points, or their levels where these are not known."""
    if push.depth_m is not None:
        return 1e3 * push.depth_m
    return np.zeros(0) if push.shape is None else push.shape.level


def _at_places(found: Mapping[str, Sequence[Pushed]]) -> Evaluation:
    """Forces at places with names."""
    contacts = {way: together([each.contact for each in many]) for way, many in found.items()}
    force = {way: scaled(contact_force_table(each), 100.0) for way, each in contacts.items()}
    return Evaluation((Comparison("forces", "Force error", "%", {}, force, _by_depth(found)),), (), (), {})


def _by_depth(found: Mapping[str, Sequence[Pushed]]) -> dict[str, str]:
    """What to call the groups of samples: levels by their depths."""
    named = {"with_cable": "with cable", "without_cable": "without cable"}
    first = next(iter(found.values()))
    pushes = [push for push in first if push.shape is not None and push.depth_m is not None]
    if not pushes:
        return named
    level = np.concatenate([push.shape.level for push in pushes if push.shape is not None])
    depth = np.concatenate([push.depth_m for push in pushes if push.depth_m is not None])
    return named | {f"level_{k}": f"{1e3 * np.mean(depth[level == k]):.3g} mm" for k in np.unique(level)}


def _point_rows(samples: ShapeSamples, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of a table of all samples."""
    columns = {"press": samples.press, "level": samples.level, "cable_mm": 1e3 * samples.cable_m}
    for k, name in enumerate(names):
        for i, axis in enumerate("xyz"):
            columns[f"{name}_{axis}_mm"] = 1e3 * samples.position_m[:, k, i]
            columns[f"true_{name}_{axis}_mm"] = 1e3 * samples.true_position_m[:, k, i]
    return columns
