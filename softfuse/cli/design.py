"""softfuse design: cavities that tell forces, places or shapes better, found by gradients."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from jaxtyping import Array, Float

from softfuse.cli.cluster import one_of
from softfuse.cli.design_casting import cast
from softfuse.cli.design_folder import DesignFolder, Identity
from softfuse.cli.design_report import After, Verified, design_page, shown
from softfuse.cli.design_run import DesignRun, Wanted, Workers
from softfuse.cli.design_worker import Task
from softfuse.cli.terminal import Quiet, busy, out_folder, printable, stdout, tracked_calls
from softfuse.cli.version import installed_version
from softfuse.design.objective import AbstractMeasure, Answers, measured
from softfuse.design.of_robot import (
    build_limits,
    build_problem,
    finer_config,
    limits_of,
    save_designed,
    searched_config,
    shown_units,
)
from softfuse.design.plan import DesignPlan, load_design
from softfuse.design.problem import Geometry
from softfuse.design.verification import pressed
from softfuse.errors import SoftfuseError
from softfuse.robot.digest import digest
from softfuse.robot.file import load
from softfuse.robot.layout.layout_mesh import layout_mesh
from softfuse.robot.mesh import build_mesh
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings

log = logging.getLogger(__name__)


def design(
    plan: Annotated[Path, typer.Argument(help="What is looked for (TOML), such as configs/design_pad.toml.")],
    out: Annotated[Path, out_folder("Folder for the results; a run in it is continued.")],
    scheduler: Annotated[
        str | None, typer.Option(help="A Dask scheduler that you trust: starts are searched on its workers.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Search starts in so many processes on this computer.", min=1)
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Find cavities whose readings tell more, and write the device, its mould and a report."""
    one_of(scheduler, workers)
    planned = load_design(plan)
    settings = load(planned.device)
    searched = searched_config(planned, settings)
    problem = build_problem(planned, searched)
    with busy("the device as it is", quiet=quiet):
        mesh = build_mesh(searched)
        own = problem.answered(build_robot(searched, mesh).model, mesh.cavities, problem.layout.start)
    problem = replace(problem, limits=build_limits(planned, settings, own, limits_of(planned)))
    before = np.asarray(measured(problem.measures, own))
    task = Task(str(plan.resolve()), digest(planned), digest(settings), installed_version())
    names = [f"{k} {measure.name}" for k, measure in enumerate(problem.measures)]
    folder = DesignFolder(out, Identity(task.version, task.plan, task.config), problem.layout.names, names)
    run = DesignRun(
        planned,
        task,
        problem,
        before,
        shown_units(settings),
        Geometry(problem.layout, problem.walls, problem.guides),
        folder,
        out,
        None if scheduler is None and workers is None else Workers(scheduler, workers),
        quiet,
    )
    found = run.searched(run.starts())
    best = min(found, key=lambda name: run.merit(found[name].best))
    found |= run.searched(_front(run, settings, own, found[best].best.theta))
    theta = found[best].best.theta
    with busy("writing the device", quiet=quiet):
        # Of the device's own fineness, not the search's.
        mesh = layout_mesh(problem.layout, theta, build_problem(planned, settings).fineness)
        save_designed(planned, settings, mesh, theta, out / "designed.toml")
        try:
            solids = cast(planned, problem.layout, theta, out / "casting")
        except SoftfuseError as error:
            # What was found is not lost with it.
            log.warning("no surfaces to cast: %s", error)
            solids = ()
    looked_at = _verified(planned, settings, problem.measures, theta, quiet=quiet)
    after = After(found, best, *looked_at, solids)
    page = design_page(planned, problem, run.units, before, folder.trials, after)
    (out / "report.html").write_text(page, encoding="utf-8")
    if not quiet:
        _tell(run, after)


def _front(
    run: DesignRun, config: RobotSettings, own: Answers, theta: Float[np.ndarray, " p"]
) -> list[Wanted]:
    """The searches of a Pareto front, from parameters (p,)."""
    front = run.plan.front
    if front is None:
        return []
    kind = "at_least" if front.at_least else "at_most"
    searches = []
    for part in front.at_least or front.at_most:
        limit = build_limits(run.plan, config, own, [front.limit(part)])
        # In the place of the one that only measures.
        limited = replace(run.problem, limits=(*run.problem.limits[:-1], *limit))
        searches.append(Wanted(f"{front.of.measure} {kind} {part:g}", limited, theta))
    return searches


def _verified(
    plan: DesignPlan,
    config: RobotSettings,
    measures: Sequence[AbstractMeasure],
    theta: Float[np.ndarray, " p"],
    *,
    quiet: bool,
) -> tuple[Verified, Verified, Array]:
    """The device as it is, and that with parameters (p,), on meshes of their own; the places."""
    finer = finer_config(config, plan.verify.finer)
    problem = build_problem(plan, finer)
    with busy("finer meshes", quiet=quiet):
        own, mesh = build_mesh(finer), problem.on_mesh(theta).mesh
        devices = (
            (build_robot(finer, own).model, own.cavities, problem.layout.start),
            (problem.build(mesh, theta), mesh.walls, theta),
        )
        at_rest = [np.asarray(measured(measures, problem.answered(*each))) for each in devices]
    with tracked_calls("pressing", total=2 * len(problem.places), quiet=quiet) as seen:
        hard = [
            pressed(device, [wall.faces for wall in walls], problem.places, plan.verify.force, seen=seen)
            for device, walls, _ in devices
        ]
    before, after = map(Verified, at_rest, hard)
    return before, after, problem.places


def _tell(run: DesignRun, after: After) -> None:
    best = after.found[after.best]
    assert best.best.value is not None
    lines = []
    for measure, was, now in zip(run.problem.measures, run.before, best.best.value.measures, strict=True):
        unit, many = shown(run.units, measure)
        of = "" if unit == "1" else f" {unit}"
        lines.append(f"{measure.name}: {many * was:.4g}{of} as it is, {many * now:.4g}{of} designed")
    if not best.kept:
        lines.append("not all limits are kept: see the report")
    text = printable("\n".join([*lines, f"written to {run.out}"]))
    stdout.print(text, markup=False, highlight=False, soft_wrap=True)
