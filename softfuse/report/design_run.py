"""A design run: searches here, with a report that grows, or side by side on workers, whose results are gone
through again here; then the robot, what it is cast with, and the report.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol, Self

import numpy as np
from jaxtyping import Array, Float

from softfuse.design.casting_of_plan import cast
from softfuse.design.folder import DesignFolder
from softfuse.design.objective import Answers, measured
from softfuse.design.of_robot import (
    build_limits,
    build_problem,
    limits_of,
    save_designed,
    search_settings,
    searched_config,
    shown_units,
)
from softfuse.design.plan import DesignPlan
from softfuse.design.problem import Geometry, Problem
from softfuse.design.search import Found, Search, Trial, merit
from softfuse.design.starts import random_starts
from softfuse.design.verification import pressed
from softfuse.design.worker import Start, Task, first_look, work_on
from softfuse.errors import MeshError, SoftfuseError
from softfuse.report.design_page import After, Verified, design_page, shown
from softfuse.robot.digest import digest
from softfuse.robot.file import load
from softfuse.robot.layout.layout_mesh import layout_mesh
from softfuse.robot.mesh import build_mesh
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings

log = logging.getLogger(__name__)


class Begin(Protocol):
    """Told of each step of a run, and of its total where that is known: what is called after each part."""

    def __call__(self, step: str, total: int | None = None, /) -> Callable[[], None]:
        """The step begins, and the one before has ended."""
        ...


class Share(Protocol):
    """Shares the starts of a step out over workers."""

    def __call__(
        self, work: Callable[[Start], list[Trial]], starts: Sequence[Start], step: str, begin: Begin, /
    ) -> AbstractContextManager[Iterator[tuple[Start, list[Trial]]]]:
        """The starts with what `work` makes of each, as they are finished."""
        ...


def designed(plan: DesignPlan, out: Path, *, share: Share | None, begin: Begin) -> list[str]:
    """Search as planned, and write the best robot found to `out`: designed.toml, its casting, report.html;
    what has improved, line by line.

    A run that is in the folder is continued; share: None to search here, one start after the other. Raises
    ConfigError for a plan that does not suit its robot, SoftfuseError for a folder of something else, where
    no start has a mesh, and as workers do; SolveError where the robot has no equilibrium.
    """
    run = DesignRun.of(plan, out, share, begin)
    found = run.searched(run.starts())
    best = min(found, key=lambda name: run.merit(found[name].best))
    theta = found[best].best.theta
    found |= run.searched(run.front(theta))
    begin("writing the robot")
    # Of the robot's own fineness, not the search's.
    mesh = layout_mesh(run.problem.layout, theta, build_problem(plan, run.config).fineness)
    save_designed(plan, run.config, mesh, theta, out / "designed.toml")
    try:
        solids = cast(plan, run.problem.layout, theta, out / "casting")
    except SoftfuseError as error:
        # What was found is not lost with it.
        log.warning("no surfaces to cast: %s", error)
        solids = ()
    after = After(found, best, *run.verified(theta), solids)
    run.show(after)
    return run.words(found[best])


@dataclass(frozen=True, eq=False)
class Wanted:
    """A search: its name, its problem, and the parameters (p,) that it starts from."""

    name: str
    problem: Problem
    theta: Float[np.ndarray, " p"]


@dataclass(frozen=True, eq=False)
class DesignRun:
    """What all searches of a run have in common; own: the answers of the robot as it is."""

    plan: DesignPlan
    config: RobotSettings
    problem: Problem
    own: Answers
    folder: DesignFolder
    out: Path
    share: Share | None
    begin: Begin

    @classmethod
    def of(cls, plan: DesignPlan, out: Path, share: Share | None, begin: Begin) -> Self:
        """Build the robot as it is, and make the folder or find the run in it."""
        config = load(plan.robot)
        searched = searched_config(plan, config)
        problem = build_problem(plan, searched)
        begin("the robot as it is")
        mesh = build_mesh(searched)
        own = problem.answered(build_robot(searched, mesh).model, mesh.cavities, problem.layout.start)
        problem = replace(problem, limits=build_limits(plan, config, own, limits_of(plan)))
        names = [f"{k} {measure.name}" for k, measure in enumerate(problem.measures)]
        identity = {"plan": digest(plan), "config": digest(config)}
        folder = DesignFolder(out, identity, problem.layout.names, names)
        return cls(plan, config, problem, own, folder, out, share, begin)

    @cached_property
    def before(self) -> Float[np.ndarray, " m"]:
        """The measures (m,) of the robot as it is, in SI."""
        return np.asarray(measured(self.problem.measures, self.own))

    @cached_property
    def _geometry(self) -> Geometry:
        return Geometry(self.problem.layout, self.problem.walls, self.problem.guides)

    def merit(self, trial: Trial) -> tuple[float, float]:
        """By how much it misses limits, then the objective."""
        return merit(self.problem, self._geometry, trial)

    def searched(self, wanted: Sequence[Wanted]) -> dict[str, Found]:
        """What the searches have found, by name."""
        if self.share is not None and wanted:
            self._on_workers(self.share, wanted, "searching", look=False)
        # What workers have computed is only gone through again.
        return {each.name: self._searched_here(each) for each in wanted}

    def starts(self) -> list[Wanted]:
        """The cavities as drawn, or the best of these and the random starts, as many as are followed.

        Raises SoftfuseError where none has a mesh.
        """
        look, layout = self.plan.search, self.problem.layout
        drawn = Wanted("as drawn", self.problem, layout.start)
        if look.starts == 0:
            return [drawn]
        self.begin("random starts")
        each = random_starts(layout, self._geometry, look.starts, look.seed)
        starts = [drawn, *(Wanted(f"start {k}", self.problem, theta) for k, theta in enumerate(each))]
        new = [start for start in starts if not self._first(start)]
        if self.share is not None and new:
            self._on_workers(self.share, new, "first looks", look=True)
        else:
            seen = self.begin("first looks", len(new))
            for start in new:
                with suppress(MeshError):
                    self.folder.add(start.name, first_look(start.problem, start.theta))
                seen()
        merits = {start.name: self.merit(first) for start in starts for first in self._first(start)}
        if not merits:
            raise SoftfuseError(
                f"{self.plan.path}: no start has a mesh: make the parameters' bounds narrower"
            )
        found = [start for start in starts if start.name in merits]
        return sorted(found, key=lambda start: merits[start.name])[: look.followed]

    def front(self, theta: Float[np.ndarray, " p"]) -> list[Wanted]:
        """The searches of a Pareto front, from parameters (p,)."""
        front = self.plan.front
        if front is None:
            return []
        kind = "at_least" if front.at_least else "at_most"
        searches = []
        for part in front.at_least or front.at_most:
            limit = build_limits(self.plan, self.config, self.own, [front.limit(part)])
            # In the place of the one that only measures.
            limited = replace(self.problem, limits=(*self.problem.limits[:-1], *limit))
            searches.append(Wanted(f"{front.of.measure} {kind} {part:g}", limited, theta))
        return searches

    def verified(self, theta: Float[np.ndarray, " p"]) -> tuple[Verified, Verified, Array]:
        """The robot as it is, and that with parameters (p,), on meshes of their own; the places."""
        plan, finer = self.plan, self.config.finer(self.plan.verify.finer)
        problem = build_problem(plan, finer)
        self.begin("finer meshes")
        own, mesh = build_mesh(finer), problem.on_mesh(theta).mesh
        models = (
            (build_robot(finer, own).model, own.cavities, problem.layout.start),
            (problem.build(mesh, theta), mesh.walls, theta),
        )
        at_rest = [np.asarray(measured(self.problem.measures, problem.answered(*each))) for each in models]
        seen = self.begin("pressing", 2 * len(problem.places))
        hard = [
            pressed(model, [wall.faces for wall in walls], problem.places, plan.verify.force, seen=seen)
            for model, walls, _ in models
        ]
        before, after = map(Verified, at_rest, hard)
        return before, after, problem.places

    def show(self, after: After | None = None) -> None:
        """Write the report, as far as the run has come."""
        trials, units = self.folder.trials, shown_units(self.config)
        if trials:
            page = design_page(self.plan, self.problem, units, self.before, trials, after)
            (self.out / "report.html").write_text(page, encoding="utf-8")

    def words(self, found: Found) -> list[str]:
        """What has improved, line by line."""
        assert found.best.value is not None
        lines = []
        for measure, was, now in zip(
            self.problem.measures, self.before, found.best.value.measures, strict=True
        ):
            unit, many = shown(shown_units(self.config), measure)
            of = "" if unit == "1" else f" {unit}"
            lines.append(f"{measure.name}: {many * was:.4g}{of} as it is, {many * now:.4g}{of} designed")
        return lines if found.kept else [*lines, "not all limits are kept: see the report"]

    def _first(self, start: Wanted) -> list[Trial]:
        """Its first trial, if known."""
        return [trial for trial in self.folder.known(start.name) if trial.leg == 0][:1]

    def _searched_here(self, wanted: Wanted) -> Found:
        known, count = self.folder.known(wanted.name), self.begin(wanted.name)

        def seen(trial: Trial) -> None:
            count()
            if self.folder.add(wanted.name, trial):
                self.show()

        settings = search_settings(self.plan)
        return Search(wanted.problem, self._geometry, settings, known=known, seen=seen).run(wanted.theta)

    def _on_workers(self, share: Share, wanted: Sequence[Wanted], step: str, *, look: bool) -> None:
        task = Task(str(self.plan.path.resolve()), digest(self.plan), digest(self.config))
        starts = []
        for each in wanted:
            bounds = tuple((limit.at_least, limit.at_most) for limit in each.problem.limits)
            known = tuple(self.folder.known(each.name))
            starts.append(Start(task, each.name, bounds, each.theta, known, look))
        with share(work_on, starts, step, self.begin) as done:
            for start, trials in done:
                for trial in trials:
                    self.folder.add(start.title, trial)
                self.show()
