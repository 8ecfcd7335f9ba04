"""The search for the best layout: sequential quadratic programming, mesh after mesh, and what was tried.

Each leg of the search has one mesh, made for the θ at which it starts, and moves at most so far from there;
it ends where the mesh has become worn, where a bound on the move is met or nothing improves any more. The
next one starts from the best θ found. Walls and limits are constraints of the method, never clipped. Every
value that was computed is kept by its leg and θ, and a search that is begun again with what an earlier one
left goes the same way without computing it again. Method: D. Kraft, A software package for sequential
quadratic programming, DFVLR-FB 88-28, 1988 (scipy's SLSQP).
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from softfuse.design.limits import room, room_slopes
from softfuse.design.problem import Geometry, MeshedProblem, Problem, Value
from softfuse.errors import MeshError

log = logging.getLogger(__name__)

_MILLIMETRE = 1e-3
_WORN = "the mesh is worn"
_LEAST_MOVE = 0.1
"""Part of the largest move at which a search gives up that wears one mesh after the other."""
_ALLOWED = 1e-3
"""Part of a limit, and of a millimetre of wall, by which a layout may miss it and counts as keeping it."""


@dataclass(frozen=True)
class SearchSettings:
    """Legs at most, iterations of the method in each, by how many times their `Parameter.scale` parameters
    may move in a leg, and the part of the objective by which a leg has to improve it for another to follow.
    """

    legs: int = 6
    iterations: int = 15
    move: float = 3.0
    improvement: float = 0.01


@dataclass(frozen=True, eq=False)
class Trial:
    """What was computed: the number of its leg, θ (p,), and its value, None where the mesh was worn."""

    leg: int
    theta: Float[np.ndarray, " p"]
    value: Value | None


@dataclass(frozen=True, eq=False)
class Found:
    """The best trial; whether it keeps all limits; how the search ended; how many trials were computed."""

    best: Trial
    kept: bool
    ended: str
    trials: int


def merit(problem: Problem, geometry: Geometry, trial: Trial) -> tuple[float, float]:
    """By how much a trial misses limits and walls, in parts of the limits and in mm, 0 where it keeps them;
    then the objective. Infinite where the mesh was worn.
    """
    if trial.value is None:
        return np.inf, np.inf
    spare = np.append(
        room(problem.limits, trial.value.measures[1:]), geometry.spare(trial.theta) / _MILLIMETRE
    )
    missing = float(np.sum(np.maximum(-spare, 0.0)))
    return (0.0 if missing <= _ALLOWED else missing), float(trial.value.measures[0])


class _Worn(Exception):
    """The mesh has to be made anew."""


class Search:
    """A search of one problem that tells `seen` each trial, those `known` from before included."""

    def __init__(
        self,
        problem: Problem,
        geometry: Geometry,
        settings: SearchSettings,
        *,
        known: Iterable[Trial] = (),
        seen: Callable[[Trial], None] = lambda trial: None,
    ) -> None:
        """geometry: of the problem's layout and walls; known: trials of a search with the same start that was
        broken off.
        """
        self._problem, self._settings, self._seen = problem, settings, seen
        self._geometry = geometry
        self._known = {(trial.leg, trial.theta.tobytes()): trial for trial in known}
        self._trials: list[Trial] = []
        self._told: set[tuple[int, bytes]] = set()
        self._starts: list[Float[np.ndarray, " p"]] = []
        self._meshed: list[MeshedProblem] = []

    def run(self, start: Float[np.ndarray, " p"]) -> Found:
        """Search from parameters (p,).

        Raises MeshError when there is no mesh for them.
        """
        settings = self._settings
        best: Trial | None = None
        ended = f"after {settings.legs} legs"
        self._trials, self._told, self._starts, self._meshed = [], set(), [], []
        at, move = np.array(start, float), settings.move
        for leg in range(settings.legs):
            self._starts.append(at)
            try:
                stopped = self._go(at, move)
            except MeshError:
                if leg == 0:
                    raise
                # No mesh where the last leg ended: stay with what it began with.
                ended = "no mesh any more"
                break
            tried = [trial for trial in self._trials if trial.leg == leg and trial.value is not None]
            first, found = tried[0], min(tried, key=self._merit)
            (missed, was), (missing, now) = self._merit(first), self._merit(found)
            log.info("mesh %d: %.6g to %.6g, %s", leg, was, now, stopped)
            best, at = found, found.theta
            if stopped == _WORN:
                # It went too far at once.
                move *= 0.5
                ended = "meshes wear out"
                if move < _LEAST_MOVE * settings.move:
                    break
            elif missing == missed and was - now <= settings.improvement * abs(was):
                ended = "nothing improves any more"
                break
        assert best is not None
        kept = self._merit(best)[0] == 0.0
        return Found(best, kept, ended, len(self._trials))

    def _merit(self, trial: Trial) -> tuple[float, float]:
        return merit(self._problem, self._geometry, trial)

    def _go(self, at: Float[np.ndarray, " p"], move: float) -> str:
        layout, scale = self._problem.layout, self._problem.layout.scale
        low = np.maximum(layout.lower, at - move * scale) / scale
        high = np.minimum(layout.upper, at + move * scale) / scale
        size = abs(self._value(at).measures[0])
        constraints = [
            {
                "type": "ineq",
                "fun": lambda x: self._geometry.spare(x * scale) / _MILLIMETRE,
                "jac": lambda x: self._geometry.slope(x * scale) * scale / _MILLIMETRE,
            }
        ]
        limits = self._problem.limits
        if limits:
            constraints.append(
                {
                    "type": "ineq",
                    "fun": lambda x: room(limits, self._value(x * scale).measures[1:]),
                    "jac": lambda x: room_slopes(limits, self._value(x * scale).slopes[1:]) * scale,
                }
            )
        try:
            result = minimize(
                lambda x: self._value(x * scale).measures[0] / size,
                np.clip(at / scale, low, high),
                jac=lambda x: self._value(x * scale).slopes[0] * scale / size,
                bounds=np.stack([low, high], axis=1),
                constraints=constraints,
                method="SLSQP",
                options={
                    "maxiter": self._settings.iterations,
                    "ftol": 0.1 * self._settings.improvement,
                },
            )
        except _Worn:
            return _WORN
        return str(result.message)

    def _value(self, theta: Float[np.ndarray, " p"]) -> Value:
        leg = len(self._starts) - 1
        key = leg, theta.tobytes()
        trial = self._known.get(key)
        if trial is None:
            trial = Trial(leg, theta.copy(), self._computed(theta))
            self._known[key] = trial
        if key not in self._told:
            self._told.add(key)
            self._trials.append(trial)
            self._seen(trial)
        if trial.value is None:
            raise _Worn
        return trial.value

    def _computed(self, theta: Float[np.ndarray, " p"]) -> Value | None:
        # A search that goes on has not made the meshes of its first legs yet.
        for start in self._starts[len(self._meshed) :]:
            last = self._meshed[-1:]
            self._meshed.append(last[0].remade(start) if last else self._problem.on_mesh(start))
        meshed = self._meshed[-1]
        return None if meshed.mesh.worn(theta) else meshed.value(theta)
