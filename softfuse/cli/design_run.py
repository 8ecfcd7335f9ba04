"""The searches of a design run: here, with a report that grows, or on workers; what is known goes on."""

from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.cli.cluster import cluster_of, finished
from softfuse.cli.design_folder import DesignFolder
from softfuse.cli.design_report import design_page
from softfuse.cli.design_worker import Start, Task, first_look, work_on
from softfuse.cli.interruption import termination_interrupts
from softfuse.cli.terminal import busy, counted, tracked, tracked_calls
from softfuse.design.of_robot import ShownUnits, search_settings
from softfuse.design.plan import DesignPlan
from softfuse.design.problem import Geometry, Problem
from softfuse.design.search import Found, Search, Trial, merit
from softfuse.design.starts import random_starts
from softfuse.errors import MeshError, SoftfuseError


@dataclass(frozen=True)
class Workers:
    """Where searches go on side by side: a Dask scheduler's address, or so many processes here."""

    scheduler: str | None
    processes: int | None


@dataclass(frozen=True, eq=False)
class Wanted:
    """A search: its name, its problem, and the parameters (p,) that it starts from."""

    name: str
    problem: Problem
    theta: Float[np.ndarray, " p"]


@dataclass(frozen=True, eq=False)
class DesignRun:
    """What all searches of a run have in common; workers: None to search here, one after the other."""

    plan: DesignPlan
    task: Task
    problem: Problem
    before: Float[np.ndarray, " m"]
    units: ShownUnits
    geometry: Geometry
    folder: DesignFolder
    out: Path
    workers: Workers | None
    quiet: bool

    def merit(self, trial: Trial) -> tuple[float, float]:
        """By how much it misses limits, then the objective."""
        return merit(self.problem, self.geometry, trial)

    def searched(self, wanted: Sequence[Wanted]) -> dict[str, Found]:
        """What the searches have found, by name."""
        if self.workers is not None and wanted:
            self._on_workers(wanted, "searching", look=False)
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
        with busy("random starts", quiet=self.quiet):
            each = random_starts(layout, self.geometry, look.starts, look.seed)
        starts = [drawn, *(Wanted(f"start {k}", self.problem, theta) for k, theta in enumerate(each))]
        new = [start for start in starts if not self._first(start)]
        if self.workers is not None and new:
            self._on_workers(new, "first looks", look=True)
        else:
            self._look_here(new)
        merits = {start.name: self.merit(first) for start in starts for first in self._first(start)}
        if not merits:
            raise SoftfuseError(
                f"{self.plan.path}: no start has a mesh: make the parameters' bounds narrower"
            )
        seen = [start for start in starts if start.name in merits]
        return sorted(seen, key=lambda start: merits[start.name])[: look.followed]

    def _first(self, start: Wanted) -> list[Trial]:
        """Its first trial, if known."""
        return [trial for trial in self.folder.known(start.name) if trial.leg == 0][:1]

    def _look_here(self, starts: Sequence[Wanted]) -> None:
        with tracked_calls("first looks", total=len(starts), quiet=self.quiet) as seen:
            for start in starts:
                with suppress(MeshError):
                    self.folder.add(start.name, first_look(start.problem, start.theta))
                seen()

    def _searched_here(self, wanted: Wanted) -> Found:
        known = self.folder.known(wanted.name)
        with counted(wanted.name, "trials", quiet=self.quiet) as count:

            def seen(trial: Trial) -> None:
                count()
                if self.folder.add(wanted.name, trial):
                    self._show()

            settings = search_settings(self.plan)
            search = Search(wanted.problem, self.geometry, settings, known=known, seen=seen)
            return search.run(wanted.theta)

    def _on_workers(self, wanted: Sequence[Wanted], title: str, *, look: bool) -> None:
        assert self.workers is not None
        starts = [self._start(each, look=look) for each in wanted]
        with termination_interrupts(), ExitStack() as until_done:
            with busy("starting workers", quiet=self.quiet):
                cluster = cluster_of(self.workers.scheduler, self.workers.processes, len(starts))
                client = until_done.enter_context(cluster)
            done = finished(client, work_on, starts)
            for start, trials in tracked(done, title, total=len(starts), quiet=self.quiet):
                for trial in trials:
                    self.folder.add(start.title, trial)
                self._show()

    def _start(self, wanted: Wanted, *, look: bool) -> Start:
        bounds = tuple((limit.at_least, limit.at_most) for limit in wanted.problem.limits)
        known = tuple(self.folder.known(wanted.name))
        return Start(self.task, wanted.name, bounds, wanted.theta, known, look)

    def _show(self) -> None:
        if self.folder.trials:
            page = design_page(self.plan, self.problem, self.units, self.before, self.folder.trials, None)
            (self.out / "report.html").write_text(page, encoding="utf-8")
