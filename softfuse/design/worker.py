"""What a worker of a design run does: the search from one start, or only a first look at it.

Client and worker exchange plain data only: paths, digests, names and numbers.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from threading import Lock

import numpy as np
from jaxtyping import Float

from softfuse.design.limits import Limit
from softfuse.design.of_robot import (
    build_problem,
    limit_measures,
    limits_of,
    search_settings,
    searched_config,
)
from softfuse.design.plan import DesignPlan, load_design
from softfuse.design.problem import Geometry, Problem
from softfuse.design.search import Search, Trial
from softfuse.errors import MeshError, SoftfuseError
from softfuse.robot.digest import digest
from softfuse.robot.file import load


@dataclass(frozen=True)
class Task:
    """What is searched: a plan's path, absolute, and the digests of plan and robot."""

    path: str
    plan: str
    config: str


@dataclass(frozen=True, eq=False)
class Start:
    """From where it is searched: lower and upper bounds of limits in SI, parameters (p,), what is known of
    the search that has this title; and whether it is only looked at.
    """

    task: Task
    title: str
    bounds: tuple[tuple[float, float], ...]
    theta: Float[np.ndarray, " p"]
    known: tuple[Trial, ...]
    look: bool


def work_on(start: Start) -> list[Trial]:
    """All trials of a start's search, or its first one; none where there is no mesh for it.

    Raises SoftfuseError when this worker has other files than the client.
    """
    with _building:
        plan, problem, geometry = _problem(start.task)
    limits = (
        Limit(limit.measure, *bounds) for limit, bounds in zip(problem.limits, start.bounds, strict=True)
    )
    problem = replace(problem, limits=tuple(limits))
    try:
        if start.look:
            return [first_look(problem, start.theta)]
        trials: list[Trial] = []
        search = Search(problem, geometry, search_settings(plan), known=start.known, seen=trials.append)
        search.run(start.theta)
    except MeshError:
        return []
    return trials


def first_look(problem: Problem, theta: Float[np.ndarray, " p"]) -> Trial:
    """The first trial of a search from parameters (p,); raises MeshError where there is no mesh."""
    return Trial(0, theta, problem.on_mesh(theta).value(theta))


_building = Lock()
"""A worker may have several threads; they share one problem."""


@lru_cache(maxsize=1)
def _problem(task: Task) -> tuple[DesignPlan, Problem, Geometry]:
    """The problem with limits that are open."""
    plan = load_design(Path(task.path))
    config = load(plan.robot)
    if (digest(plan), digest(config)) != (task.plan, task.config):
        raise SoftfuseError(f"{task.path}: a worker finds other files than here: share the folder")
    problem = build_problem(plan, searched_config(plan, config))
    open_limits = tuple(map(Limit, limit_measures(plan, config, limits_of(plan))))
    problem = replace(problem, limits=open_limits)
    return plan, problem, Geometry(problem.layout, problem.walls, problem.guides)
