"""softfuse design: cavities that tell forces, places or shapes better, found by gradients."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from jaxtyping import Array, Float

from softfuse.cli.design_casting import cast
from softfuse.cli.design_folder import DesignFolder, Identity
from softfuse.cli.design_report import After, design_page, shown
from softfuse.cli.sweep_worker import installed_version
from softfuse.cli.terminal import Quiet, busy, counted, printable, stdout, tracked_calls
from softfuse.config import DeviceConfig, load
from softfuse.config.build_design import (
    ShownUnits,
    build_limits_of,
    build_problem,
    finer_config,
    save_designed,
    search_settings,
    shown_units,
)
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.config.design_plan import DesignPlan, load_design
from softfuse.config.digest import digest
from softfuse.design.problem import Geometry, Problem
from softfuse.design.search import Found, Search, Trial, merit
from softfuse.design.starts import random_starts
from softfuse.design.verification import Pressed, pressed
from softfuse.errors import MeshError, SoftfuseError
from softfuse.estimation.device import Device

log = logging.getLogger(__name__)


def design(
    plan: Annotated[Path, typer.Argument(help="What is looked for (TOML), such as configs/design_pad.toml.")],
    out: Annotated[Path, typer.Option(help="Folder for the results; a run in it is continued.")],
    quiet: Quiet = False,
) -> None:
    """Find cavities whose readings tell more, and write the device, its mould and a report."""
    planned = load_design(plan)
    settings = load(planned.device)
    problem = build_problem(planned, settings)
    with busy("the device as it is", quiet=quiet):
        device = build_device(settings)
        fronts = () if planned.front is None else (planned.front.unlimited,)
        limits = build_limits_of(planned, settings, device, problem, (*planned.limits, *fronts))
        problem = replace(problem, limits=limits)
        before = _measures(problem, device)
    identity = Identity(installed_version(), digest(planned), digest(settings))
    names = [f"{k} {measure.name}" for k, measure in enumerate(problem.measures)]
    folder = DesignFolder(out, identity, problem.layout.names, names)
    geometry = Geometry(problem.layout, problem.walls)
    run = _Run(planned, problem, before, shown_units(settings), geometry, folder, out)
    starts = _starts(run, quiet=quiet)
    found = {name: run.search(name, problem, start, quiet=quiet) for name, start in starts.items()}
    best = min(found, key=lambda name: run.merit(found[name].best))
    for name, limited in _front(planned, settings, device, problem):
        found[name] = run.search(name, limited, found[best].best.theta, quiet=quiet)
    theta = found[best].best.theta
    with busy("writing the device", quiet=quiet):
        mesh = problem.on_mesh(theta).mesh
        save_designed(planned, settings, mesh, theta, out / "designed.toml")
        try:
            solids = cast(planned, problem.layout, theta, out / "casting")
        except SoftfuseError as error:
            # What was found is not lost with it.
            log.warning("no surfaces to cast: %s", error)
            solids = ()
    looked_at = _verified(planned, settings, theta, quiet=quiet)
    after = After(found, best, *looked_at, solids)
    page = design_page(planned, problem, run.units, before, run.folder.trials, after)
    (out / "report.html").write_text(page, encoding="utf-8")
    if not quiet:
        _tell(run, after)


@dataclass(frozen=True, eq=False)
class _Run:
    """What all searches of a run have in common."""

    plan: DesignPlan
    problem: Problem
    before: Float[np.ndarray, " m"]
    units: ShownUnits
    geometry: Geometry
    folder: DesignFolder
    out: Path

    def search(self, name: str, problem: Problem, start: Float[np.ndarray, " p"], *, quiet: bool) -> Found:
        """Search from parameters (p,), what is known of it from before included."""
        known = self.folder.known(name)
        with counted(name, "trials", quiet=quiet) as count:

            def seen(trial: Trial) -> None:
                count()
                if not self.folder.add(name, trial):
                    return
                page = design_page(self.plan, self.problem, self.units, self.before, self.folder.trials, None)
                (self.out / "report.html").write_text(page, encoding="utf-8")

            search = Search(problem, self.geometry, search_settings(self.plan), known=known, seen=seen)
            return search.run(start)

    def merit(self, trial: Trial) -> tuple[float, float]:
        """By how much it misses limits, then the objective."""
        return merit(self.problem, self.geometry, trial)


def _measures(problem: Problem, device: Device) -> Float[np.ndarray, " m"]:
    answers = problem.answers(device, problem.watch(device))
    return np.array([float(measure(answers)) for measure in problem.measures])


def _starts(run: _Run, *, quiet: bool) -> dict[str, Float[np.ndarray, " p"]]:
    """The cavities as drawn, then the best of the random starts, as many as are followed in all."""
    look, layout = run.plan.search, run.problem.layout
    starts = {"as drawn": layout.start}
    if look.starts == 0:
        return starts
    with busy("random starts", quiet=quiet):
        each = random_starts(layout, run.geometry, look.starts, look.seed)
    starts |= {f"start {k}": theta for k, theta in enumerate(each)}
    merits = {}
    with tracked_calls("first looks", total=len(starts), quiet=quiet) as seen:
        for name, theta in starts.items():
            first = _first_look(run, name, theta)
            seen()
            if first is not None:
                merits[name] = run.merit(first)
    if not merits:
        raise SoftfuseError(f"{run.plan.path}: no start has a mesh: make the parameters' bounds narrower")
    chosen = sorted(merits, key=lambda name: merits[name])[: look.followed]
    return {name: starts[name] for name in chosen}


def _first_look(run: _Run, name: str, theta: Float[np.ndarray, " p"]) -> Trial | None:
    """The first trial of a search from parameters (p,); None where there is no mesh."""
    known = [trial for trial in run.folder.known(name) if trial.leg == 0]
    if known:
        return known[0]
    try:
        trial = Trial(0, theta, run.problem.on_mesh(theta).value(theta))
    except MeshError:
        return None
    run.folder.add(name, trial)
    return trial


def _front(
    plan: DesignPlan, config: DeviceConfig, device: Device, problem: Problem
) -> list[tuple[str, Problem]]:
    """The problems of a Pareto front, by name."""
    front = plan.front
    if front is None:
        return []
    kind = "at_least" if front.at_least else "at_most"
    problems = []
    for part in front.at_least or front.at_most:
        limit = build_limits_of(plan, config, device, problem, [front.limit(part)])
        # In the place of the one that only measures.
        limited = replace(problem, limits=(*problem.limits[:-1], *limit))
        problems.append((f"{front.of.measure} {kind} {part:g}", limited))
    return problems


def _verified(
    plan: DesignPlan, config: DeviceConfig, theta: Float[np.ndarray, " p"], *, quiet: bool
) -> tuple[Pressed, Pressed, Array]:
    """The device as it is, and that with parameters (p,), pressed on meshes of their own; the places."""
    finer = finer_config(config, plan.verify.finer)
    problem = build_problem(plan, finer)
    with busy("finer meshes", quiet=quiet):
        own, mesh = build_mesh(finer), problem.on_mesh(theta).mesh
        devices = (
            (build_device(finer, own), own.cavities),
            (problem.build(mesh, theta), mesh.walls),
        )
    with tracked_calls("pressing", total=2 * len(problem.places), quiet=quiet) as seen:
        before, after = (
            pressed(device, [wall.faces for wall in walls], problem.places, plan.verify.force, seen=seen)
            for device, walls in devices
        )
    return before, after, problem.places


def _tell(run: _Run, after: After) -> None:
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
