"""How many solves a search by gradients, one by finite differences and CMA-ES need for equally good cavities.

    .venv/bin/python benchmarks/design_search.py [PLAN] [--coarser TIMES] [--most N] [--seed N]

PLAN is a design task, configs/design_pad.toml if none is given; its robot's mesh has edges that are so many
times longer (1.6), so that thousands of solves are affordable, and stays the same for all: layouts in which
it is worn are refused to each. All begin with the cavities as drawn, may move as far as a search does on one
mesh and keep the same walls and limits: the first two by SLSQP, CMA-ES by an augmented Lagrangian (pycma). A
solve is one layout's answer to all presses; one with gradients counts as one, and takes longer, so seconds
are told too, without compiling.
Printed: the best objective that keeps walls and limits after so many solves, and how many each needs to come
within 1 % of what gradients found. CMA-ES is given up after N solves (1500).
"""

import argparse
import time
from collections.abc import Callable
from contextlib import chdir, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cma
import numpy as np
from scipy.optimize import minimize

from softfuse.computing.prepare import prepare_jax
from softfuse.design.limits import room, room_slopes
from softfuse.design.of_robot import build_limits, build_problem
from softfuse.design.plan import load_design
from softfuse.design.problem import Geometry, MeshedProblem, Problem
from softfuse.robot.file import load
from softfuse.robot.mesh import build_mesh
from softfuse.robot.robot import build_robot

_KEPT = 1e-3
"""By how many parts of a limit, or millimetres of wall, a layout may miss these."""
_EQUAL = 1.01


class _Enough(Exception):
    """The budget is spent."""


@dataclass
class Count:
    """Solves so far, the seconds that they took, and after each the best objective that keeps all limits."""

    solves: int = 0
    seconds: float = 0.0
    best: list[float] = field(default_factory=list)
    at_s: list[float] = field(default_factory=list)

    def until(self, aim: float) -> tuple[int, float] | None:
        """Solves and seconds until the objective was at most `aim`; None where it never was."""
        for k, value in enumerate(self.best):
            if value <= aim:
                return k + 1, self.at_s[k]
        return None


class Task:
    """A problem on one mesh, in parameters over their scales, with its solves counted."""

    def __init__(self, problem: Problem, meshed: MeshedProblem, geometry: Geometry) -> None:
        self.problem, self.meshed, self.geometry = problem, meshed, geometry
        self.scale, self.count = problem.layout.scale, Count()
        self._kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def values(self, x: np.ndarray) -> np.ndarray:
        """Objective, then by how much what must not be negative is missed (1 + c,), by one solve."""
        count = len(self.scale)
        return self._counted(x, lambda theta: (self.meshed.measures(theta), np.zeros((0, count))))[0]

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same and its derivatives, by one solve with gradients."""

        def solved(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value = self.meshed.value(theta)
            return value.measures, value.slopes

        return self._counted(x, solved)

    def _counted(self, x: np.ndarray, solve: Callable) -> tuple[np.ndarray, np.ndarray]:
        key = x.tobytes()
        if key in self._kept:
            return self._kept[key]
        theta = x * self.scale
        begin = time.perf_counter()
        if self.meshed.mesh.worn(theta):
            measures, slopes = np.full(1 + len(self.problem.limits), np.nan), np.zeros((0, len(x)))
        else:
            measures, slopes = solve(theta)
            self.count.solves += 1
        self.count.seconds += time.perf_counter() - begin
        within = room(self.problem.limits, measures[1:])
        spare = 1e3 * self.geometry.spare(theta)
        values = np.concatenate([measures[:1], within, spare])
        kept = np.all(np.concatenate([within, spare]) >= -_KEPT) and np.isfinite(measures[0])
        best = self.count.best[-1] if self.count.best else np.inf
        self.count.best.append(min(best, float(measures[0])) if kept else best)
        self.count.at_s.append(self.count.seconds)
        found = values, slopes
        if len(slopes):
            rows = slopes[:1], room_slopes(self.problem.limits, slopes[1:]), 1e3 * self.geometry.slope(theta)
            found = values, np.vstack(rows) * self.scale
        self._kept[key] = found
        return found


def by_slsqp(task: Task, start: np.ndarray, bounds: np.ndarray, *, gradients: bool, most: int) -> None:
    """SLSQP, its derivatives ours or finite differences."""

    def value(x: np.ndarray) -> np.ndarray:
        if len(task.count.best) >= most:
            raise _Enough
        found = task.slopes(x)[0] if gradients else task.values(x)
        if not np.isfinite(found[0]):
            raise _Enough
        return found

    constraint = {"type": "ineq", "fun": lambda x: value(x)[1:]}
    if gradients:
        constraint["jac"] = lambda x: task.slopes(x)[1][1:]
    with suppress(_Enough):
        minimize(
            lambda x: value(x)[0],
            start,
            jac=(lambda x: task.slopes(x)[1][0]) if gradients else "2-point",
            bounds=bounds,
            constraints=constraint,
            method="SLSQP",
            options={"maxiter": 40, "ftol": 1e-4, **({} if gradients else {"eps": 1e-4})},
        )


def by_cma(task: Task, start: np.ndarray, bounds: np.ndarray, *, most: int, seed: int) -> None:
    """CMA-ES with an augmented Lagrangian; layouts whose mesh is worn are told to be bad."""

    def safe(x: np.ndarray) -> np.ndarray:
        found = task.values(np.asarray(x))
        return np.where(np.isfinite(found), found, 10.0 if not np.isfinite(found[0]) else 0.0)

    lagrangian = cma.ConstrainedFitnessAL(
        lambda x: float(safe(x)[0]), lambda x: (-safe(x)[1:]).tolist(), find_feasible_first=False
    )
    options = {"bounds": bounds.T.tolist(), "seed": seed + 1, "verbose": -9, "maxfevals": 10 * most}
    strategy = cma.CMAEvolutionStrategy(start.tolist(), 1.0, options)
    while not strategy.stop() and task.count.solves < most:
        asked = strategy.ask()
        strategy.tell(asked, [lagrangian(x) for x in asked])
        lagrangian.update(strategy)


def main() -> None:
    """Read the arguments, run all three, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path, nargs="?", default=Path("configs/design_pad.toml"))
    parser.add_argument("--coarser", type=float, default=1.6)
    parser.add_argument("--most", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    prepare_jax()
    plan = load_design(given.plan)
    config = load(plan.robot).finer(1.0 / given.coarser)
    problem = build_problem(plan, config)
    own = build_mesh(config)
    answers = problem.answered(build_robot(config, own).model, own.cavities, problem.layout.start)
    problem = replace(problem, limits=build_limits(plan, config, answers, plan.limits))
    layout = problem.layout
    geometry = Geometry(layout, problem.walls, problem.guides)
    theta = layout.start
    meshed = problem.on_mesh(theta)
    start = theta / layout.scale
    for compiled in (meshed.value, meshed.measures):
        compiled(theta)
    low = np.maximum(layout.lower / layout.scale, start - plan.search.move)
    high = np.minimum(layout.upper / layout.scale, start + plan.search.move)
    bounds = np.stack([low, high], axis=1)
    print(f"{len(start)} parameters, {len(meshed.mesh.boxes)} nodes, {len(problem.places)} presses")
    runs: dict[str, Count] = {}
    for name in ("gradients", "finite differences", "CMA-ES"):
        task = Task(problem, meshed, geometry)
        if name == "CMA-ES":
            # It keeps a journal where it runs.
            with TemporaryDirectory() as folder, chdir(folder):
                by_cma(task, start, bounds, most=given.most, seed=given.seed)
        else:
            by_slsqp(task, start, bounds, gradients=name == "gradients", most=given.most)
        runs[name] = task.count
        print(
            f"{name}: {task.count.solves} solves, {task.count.seconds:.0f} s, best {task.count.best[-1]:.4f}"
        )
    aim = _EQUAL * runs["gradients"].best[-1]
    least = runs["gradients"].until(aim)
    assert least is not None
    print(f"until {aim:.4f}:")
    for name, count in runs.items():
        reached = count.until(aim)
        if reached is None:
            times = count.solves / least[0]
            print(f"  {name}: not within {count.solves} solves, more than {times:.0f} times as many")
        else:
            solves, seconds = reached
            as_many, as_long = solves / least[0], seconds / least[1]
            print(f"  {name}: {solves} solves, {as_many:.1f} times; {seconds:.0f} s, {as_long:.1f} times")


if __name__ == "__main__":
    main()
