"""The page of a design run: what was tried, and once it is done, before and after."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.casting_check import SolidCheck
from softfuse.design.objective import AbstractMeasure
from softfuse.design.of_robot import ShownUnits
from softfuse.design.plan import DesignPlan
from softfuse.design.problem import Problem
from softfuse.design.search import Found, Trial
from softfuse.design.verification import Pressed
from softfuse.report.figures import outlines, sensitivity_maps, tried
from softfuse.report.page import page, picture, table
from softfuse.robot.layout.cube_sphere import cube_sphere
from softfuse.robot.layout.layout import AbstractLayout
from softfuse.robot.layout.thickness import wall_names, wall_thicknesses

_CELLS = 8
"""Along an edge of the cube through which cavities are drawn."""


@dataclass(frozen=True, eq=False)
class Verified:
    """A robot looked at again on a finer mesh: measures (m,) in SI, and presses of a real force."""

    measures: Float[np.ndarray, " m"]
    pressed: Pressed


@dataclass(frozen=True, eq=False)
class After:
    """What a run has found: by search, and the best one's name; the robot as it is and as designed, looked
    at again at places; what was checked of the casting.
    """

    found: Mapping[str, Found]
    best: str
    own: Verified
    designed: Verified
    places: Array
    solids: tuple[SolidCheck, ...]


def design_page(
    plan: DesignPlan,
    problem: Problem,
    units: ShownUnits,
    before: Float[np.ndarray, " m"],
    trials: Sequence[tuple[str, Trial]],
    after: After | None,
) -> str:
    """The page, as far as the run has come; before (m,): the measures of the robot as it is, in SI."""
    sections = [("Tried", _tried(problem, units, before, trials))]
    if after is None:
        last = [trial for _, trial in trials][-1]
        sections.append(("Last", _drawn(problem.layout, last.theta)))
    else:
        sections = [*_outcome(problem, units, before, after), *sections]
    return page(f"{plan.path.name}: design", sections)


def shown(units: ShownUnits, measure: AbstractMeasure) -> tuple[str, float]:
    """The unit that people read a measure in, and how many of it are one in SI."""
    return units.get(measure.unit, (measure.unit, 1.0))


def _tried(
    problem: Problem,
    units: ShownUnits,
    before: Float[np.ndarray, " m"],
    trials: Sequence[tuple[str, Trial]],
) -> str:
    unit, many = shown(units, problem.objective)
    searches: dict[str, list[float]] = {}
    for name, trial in trials:
        value = np.nan if trial.value is None else many * float(trial.value.measures[0])
        searches.setdefault(name, []).append(value)
    figure = tried(
        {name: np.array(values) for name, values in searches.items()},
        f"{problem.objective.name} [{unit}]",
        many * float(before[0]),
    )
    told = picture(figure, f"{len(trials)} layouts; gaps are where a new mesh was due.")
    jumps = [
        (name, str(leg), *(f"{100.0 * part:.2g} %" for part in parts))
        for name, leg, parts in across_meshes(trials)
    ]
    if jumps:
        names = [measure.name for measure in problem.measures]
        told += "<p>By how much measures of the same layout change where a new mesh goes on:</p>"
        told += table(("search", "mesh", *names), jumps)
    return told


def across_meshes(
    trials: Sequence[tuple[str, Trial]],
) -> list[tuple[str, int, Float[np.ndarray, " m"]]]:
    """Of each mesh that went on from another one, the search, its number from 1 and by which part (m,) [-]
    the measures of the layout that both have changed.
    """
    values = {
        (name, trial.leg, trial.theta.tobytes()): trial.value.measures
        for name, trial in trials
        if trial.value is not None
    }
    changes = []
    for (name, leg, theta), after in values.items():
        before = values.get((name, leg - 1, theta))
        if before is not None:
            changes.append((name, leg, np.abs(after / before - 1.0)))
    return changes


def _drawn(layout: AbstractLayout, theta: Float[np.ndarray, " p"]) -> str:
    def cavities(at):
        directions, _ = cube_sphere(_CELLS)
        points = layout.points(jnp.asarray(at), [directions] * len(layout.shapes))
        return [1e3 * np.asarray(each) for each in points]

    figure = outlines(
        1e3 * layout.outline.low, 1e3 * layout.outline.high, cavities(layout.start), cavities(theta)
    )
    return picture(
        figure, "Outlines of the cavities from above, from the front and from the side; dashed: as drawn."
    )


def _outcome(
    problem: Problem, units: ShownUnits, before: Float[np.ndarray, " m"], after: After
) -> list[tuple[str, str]]:
    found = after.found[after.best]
    theta, value = found.best.theta, found.best.value
    assert value is not None
    looked_at = zip(before, value.measures, after.own.measures, after.designed.measures, strict=True)
    measures = [
        (measure.name, unit, *(f"{many * number:.4g}" for number in numbers))
        for measure, numbers in zip(problem.measures, looked_at, strict=True)
        for unit, many in (shown(units, measure),)
    ]
    unit, many = units["reading/N"]
    own, designed = after.own.pressed, after.designed.pressed
    checked = [
        ("unevenness of the sensitivity", own.unevenness, designed.unevenness),
        (f"mean sensitivity [{unit}]", many * own.sensitivity.mean(), many * designed.sensitivity.mean()),
        ("mean depth [mm/N]", 1e3 * own.softness.mean(), 1e3 * designed.softness.mean()),
        ("least part of cavities' heights left", own.open_part.min(), designed.open_part.min()),
        ("largest stretch", own.stretch.max(), designed.stretch.max()),
        ("nodes of the mesh", own.nodes, designed.nodes),
    ]
    parameters = [
        (name, f"{1e3 * x:.3f} mm" if p.unit == "m" else f"{x:.4f}")
        for name, x, p in zip(problem.layout.names, theta, problem.layout.parameters, strict=True)
    ]
    walls = _walls(problem, theta)
    own_unit, own_many = shown(units, problem.objective)
    ends = [
        (
            name,
            each.ended,
            str(each.trials),
            f"{own_many * _objective(each):.4g}",
            "yes" if each.kept else "no",
        )
        for name, each in after.found.items()
    ]
    solids = [
        (solid.name, f"{solid.volume_mm3:.1f}", str(solid.genus), "yes" if solid.watertight else "no")
        for solid in after.solids
    ]
    return [
        (
            "Before and after",
            table(
                ("measure", "unit", "as it is", "designed", "as it is, finer mesh", "designed, finer mesh"),
                measures,
            ),
        ),
        (
            "Looked at again, by equilibria on a finer mesh",
            table(
                ("of the presses", "as it is", "designed"),
                [(name, f"{was:.4g}", f"{now:.4g}") for name, was, now in checked],
            )
            + _maps(unit, many, after),
        ),
        (
            "Cavities",
            _drawn(problem.layout, theta) + table(("parameter", "added to what was drawn"), parameters),
        ),
        ("Walls", table(("wall", "thickness [mm]", "at least [mm]"), walls)),
        (
            "Searches",
            table(
                ("search", "ended as", "layouts", f"{problem.objective.name} [{own_unit}]", "keeps limits"),
                ends,
            ),
        ),
        ("Casting", table(("solid", "volume [mm³]", "handles", "watertight"), solids)),
    ]


def _objective(found: Found) -> float:
    assert found.best.value is not None
    return float(found.best.value.measures[0])


def _walls(problem: Problem, theta: Float[np.ndarray, " p"]) -> list[tuple[str, str, str]]:
    thickness = np.asarray(wall_thicknesses(problem.layout, jnp.asarray(theta)))
    least = problem.walls.least(problem.layout)
    order = np.argsort(thickness - least)
    names = wall_names(problem.layout)
    return [(names[k], f"{1e3 * thickness[k]:.3f}", f"{1e3 * least[k]:.3f}") for k in order[:12]]


def _maps(unit: str, many: float, after: After) -> str:
    places = np.asarray(after.places)[:, 0]
    if np.ptp(places[:, 2]) > 0:
        return ""
    values = {
        "as it is": many * after.own.pressed.sensitivity,
        "designed": many * after.designed.pressed.sensitivity,
    }
    figure = sensitivity_maps(1e3 * places[:, 0], 1e3 * places[:, 1], values)
    return picture(figure, f"Norm of the readings per newton [{unit}].")
