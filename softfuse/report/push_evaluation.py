"""What `softfuse evaluate` says of pushes: Table III, Figures 12 and 13 of Navarro et al. 2020."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from softfuse.experiment.accuracy import (
    PULLED_M,
    ContactSamples,
    ShapeSamples,
    contact_force_table,
    position_table,
    scaled,
    together,
)
from softfuse.experiment.paper.reported import POSITION_ERROR_MM
from softfuse.experiment.pose_cache import Arrays
from softfuse.mesh.surface import outer_surface
from softfuse.report import figures, shape_figures
from softfuse.report.evaluation import Comparison, Evaluation, Evaluator, Plate
from softfuse.report.sections import largest_shapes
from softfuse.report.shape_figures import Shape
from softfuse.report.study import Study
from softfuse.robot.robot import Robot


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


_PARTS: Mapping[str, type] = {"shape": ShapeSamples, "contact": ContactSamples, "largest": Shape}


def _said(study: Study) -> Arrays:
    """What is kept of a push."""
    shape, contact, depth_mm = study.shape_samples, study.contact_samples, study.truth.depth_mm
    assert shape is not None and contact is not None and depth_mm is not None  # the test bed knows
    depth = 1e-3 * depth_mm[study.truth.samples(study.point_columns)]
    return Pushed(shape, contact, depth, largest_shapes(study)[0]).arrays


def _evaluation(robot: Robot, found: Mapping[str, Sequence[Arrays]]) -> Evaluation:
    """The evaluation of pushes, each estimated in some ways."""
    pushes = {way: [Pushed.of(each) for each in many] for way, many in found.items()}
    names = [point.name for point in robot.settings.points]
    shapes = {way: together([each.shape for each in many]) for way, many in pushes.items()}
    contacts = {way: together([each.contact for each in many]) for way, many in pushes.items()}
    position = {way: scaled(position_table(each, names), 1e3) for way, each in shapes.items()}
    force = {way: scaled(contact_force_table(each), 100.0) for way, each in contacts.items()}
    named = _named(next(iter(pushes.values())))
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
    return Evaluation(tables, tuple(plates), (), {way: _rows(each, names) for way, each in shapes.items()})


def _named(pushes: Sequence[Pushed]) -> dict[str, str]:
    """What to call the groups of samples: levels by their depths."""
    level = np.concatenate([push.shape.level for push in pushes])
    depth = np.concatenate([push.depth_m for push in pushes])
    levels = {f"level_{k}": f"{1e3 * np.mean(depth[level == k]):.3g} mm" for k in np.unique(level)}
    return {"with_cable": "with cable", "without_cable": "without cable"} | levels


def _rows(samples: ShapeSamples, names: Sequence[str]) -> dict[str, np.ndarray]:
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
    _said,
    _evaluation,
)
"""Table III, Figures 12 and 13."""
