"""Pushes on a virtual finger: the equilibria that it passes through; material for Table III of Navarro et al.
2020.

A push shortens the cable first, then sets rigid round tips against sides of segments where these are now and
moves all of them on along straight lines by the same depth, counted for each from its own first contact.
Everything is elastic and without friction, so that the way back passes through the same equilibria.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import ConfigError, SolveError
from softfuse.experiment.equilibria import RobotSolver, Touched, stacked
from softfuse.experiment.paper.tips import Side, Tips, passed_through, patch_of, set_against
from softfuse.experiment.pose_cache import Arrays
from softfuse.experiment.virtual_robot import VirtualRobot
from softfuse.functional.chart import facing
from softfuse.mechanics.load import Loads
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.rigid_cylinder import RigidCylinder
from softfuse.mechanics.solution import RESULTS, State
from softfuse.sensors.parts import TrueContact

log = logging.getLogger(__name__)

_LENGTHS_AWAY = 2.0
"""Lengths of the finger by which the tips stand back while the cable alone moves it."""

_HALVINGS = 5
"""How often a step between two equilibria may be halved."""


@dataclass(frozen=True)
class Push:
    """Segments and sides that tips push on, cable shortening in m, and increasing depths in m to hold."""

    contacts: tuple[tuple[int, Side], ...] = ()
    cable: float = 0.0
    depths: tuple[float, ...] = ()

    def __str__(self) -> str:
        tips = " and ".join(f"{side} of segment {segment}" for segment, side in self.contacts)
        return f"{tips or 'no contact'}, cable shortened by {1e3 * self.cable:g} mm"


@dataclass(frozen=True)
class Steps:
    """Largest steps in m between equilibria, of cable and tips."""

    cable: float = 2.5e-3
    depth: float = 2.5e-3


_DEPTHS_M = (5e-3, 10e-3, 15e-3, 20e-3)
_DEPTHS_OF_TWO_M = (2e-3, 4e-3, 6e-3, 8e-3)

TABLE_III = tuple(
    Push(contacts=((segment, "left"),), cable=cable, depths=_DEPTHS_M)
    for segment in (3, 2)
    for cable in (0.0, 10e-3)
)
"""The tip segment (the paper's p0), then the third (p3), each without and with the cable."""

TWO_CONTACTS = (
    Push(((1, "left"), (3, "right")), 0.0, _DEPTHS_OF_TWO_M),
    # Bent by the cable, the finger finds no equilibrium between these tips beyond.
    Push(((1, "left"), (3, "right")), 10e-3, _DEPTHS_OF_TWO_M[:3]),
    Push(((2, "left"), (3, "palm")), 0.0, _DEPTHS_OF_TWO_M),
    Push(((1, "left"), (3, "palm")), 10e-3, _DEPTHS_OF_TWO_M[:3]),
)
"""Two tips at once on different segments."""

CABLE_ALONE = tuple(Push(cable=cable) for cable in (2.5e-3, 5e-3, 7.5e-3, 10e-3))
"""Nothing touches."""


def cable_levels(push: Push, steps: Steps) -> Float[np.ndarray, " n"]:
    """Shortenings (n,) m on the way from 0 to the push's."""
    return _levels((0.0, push.cable), steps.cable)


def depth_levels(push: Push, steps: Steps) -> Float[np.ndarray, " n"]:
    """Depths (n,) m on the way from 0 through all that are held."""
    return _levels((0.0, *push.depths), steps.depth)


def equilibria(push: Push, steps: Steps) -> int:
    """How many equilibria `PushSolver.poses` solves for."""
    return len(cable_levels(push, steps)) + len(depth_levels(push, steps)) - 2


class PushSolver:
    """Equilibria of one virtual finger with one cable under tips that stand for its first contact; a program
    is compiled for each number of tips.
    """

    def __init__(self, robot: VirtualRobot, tips: Tips, steps: Steps) -> None:
        """Raises ConfigError for a robot without contacts, or without one cable that is shortened."""
        self._bench, self._made, self._tips, self._steps = RobotSolver(robot), robot.made, tips, steps
        settings = robot.made.settings
        if len(settings.cables) != 1 or not settings.contacts:
            raise ConfigError(f"{settings.path}: cable: a finger that is pushed has one, and a [[contact]]")
        self._contact = settings.contacts[0]
        self._body = robot.made.parts.body
        self._actuators = self._bench.model(()).actuators
        self._newton = Newton(robot.made.model.linear)
        self._solve = eqx.filter_jit(solve)

    def poses(self, push: Push, *, solved: Callable[[], None] | None = None) -> Arrays:
        """The equilibria of a push as `RobotSolver.poses` has them: rest, the way of the cable, the tips
        before and at first contact, the depths.

        `solved` is called after each equilibrium. Raises ConfigError for tips or depths that make no push,
        SolveError when an equilibrium is not found.
        """
        self._check(push)
        done = solved or (lambda: None)
        tips = tuple(self._tips.before(self._body, *place) for place in push.contacts)
        loads = Loads((*tips, *self._actuators))
        state = State.rest(self._body, loads)
        away = np.full(len(tips), -_LENGTHS_AWAY * self._tips.size[0])
        under_cable = [state]
        levels = cable_levels(push, self._steps)
        for shortening in levels[1:]:
            drive = self._drive(state, away, shortening)
            where = f"{push}: on the way, at {1e3 * shortening:g} mm"
            under_cable.append(self._next(tips, loads, under_cable[-1], drive, where))
            done()
        state = under_cable[-1]
        placed = [
            set_against(tip, patch_of(tip, self._body, state.z).reshape(*self._tips.points, 3))
            for tip in tips
        ]
        tips = tuple(tip for tip, _ in placed)
        first = np.array([advance for _, advance in placed])
        gaps = self._bench.gaps
        poses = []
        for k, at in enumerate(under_cable):
            held = not tips and k == len(under_cable) - 1
            poses.append(self._pose(loads, push, tips, at, first, -gaps[0], held=held))
        if not tips:
            return stacked(poses)
        # First contact without force is the equilibrium of the cable alone, with the tips there.
        loads = Loads((*tips, *self._actuators))
        state = eqx.tree_at(lambda s: s.drive, state, self._drive(state, first, push.cable))
        poses += [self._pose(loads, push, tips, state, first, -gap) for gap in gaps[1:]]
        for depth in depth_levels(push, self._steps)[1:]:
            drive = self._drive(state, first + depth, push.cable)
            state = self._next(tips, loads, state, drive, f"{push}: at a depth of {1e3 * depth:g} mm")
            held = bool(np.any(np.isclose(push.depths, depth)))
            poses.append(self._pose(loads, push, tips, state, first, depth, held=held))
            done()
        return stacked(poses)

    def places(self, push: Push) -> Float[np.ndarray, "c 3"]:
        """Where each slot's tip pushes on the body at rest (c, 3) m, NaN where there is none."""
        places = np.full((len(self._made.workspaces), 3), np.nan)
        for slot, place in enumerate(push.contacts):
            places[slot] = self._tips.middle(*place)
        return places

    def _drive(self, state: State, advance: Float[np.ndarray, " t"], shortening: float) -> Float[Array, " d"]:
        """All drives: tips (t,) m, cable in m, the rest as it is."""
        after = state.drive[len(advance) + 1 :]
        return jnp.concatenate([jnp.asarray(advance, float), jnp.array([float(shortening)]), after])

    def _next(
        self,
        tips: tuple[RigidCylinder, ...],
        loads: Loads,
        state: State,
        drive: Float[Array, " d"],
        where: str,
    ) -> State:
        """The equilibrium at a drive, by smaller steps where a large one does not lead there."""
        ahead = [drive]
        iterations = 0
        while ahead:
            found = self._solve(self._newton, self._body, loads, ahead[-1], state)
            iterations += int(found.stats.newton_iterations)
            converged = bool(found.result == RESULTS.converged)
            if converged and not any(
                passed_through(tip, float(advance), patch_of(tip, self._body, found.state.z))
                for tip, advance in zip(tips, np.asarray(found.state.drive), strict=False)
            ):
                state = found.state
                ahead.pop()
            elif len(ahead) <= _HALVINGS:
                ahead.append(0.5 * (state.drive + ahead[-1]))
            else:
                why = "a tip passes through the finger" if converged else RESULTS[found.result]
                raise SolveError(f"{where}: no equilibrium: {why}; push less deep, or with other tips")
        log.info("%s: %d iterations", where, iterations)
        return state

    def _pose(
        self,
        loads: Loads,
        push: Push,
        tips: tuple[RigidCylinder, ...],
        state: State,
        first: Float[np.ndarray, " t"],
        depth: float,
        *,
        held: bool = False,
    ) -> dict[str, np.ndarray]:
        forces, start, there = np.asarray(state.force), 0, []
        for slot, (tip, place) in enumerate(zip(tips, push.contacts, strict=True)):
            count = tip.sizes.forces
            total = forces[start : start + count].reshape(-1, 3).sum(axis=0) if depth > 0 else np.zeros(3)
            start += count
            middle = np.asarray(tip.centre) + (first[slot] + depth) * np.asarray(tip.direction)
            seen = TrueContact(
                facing(self._tips.middle(*place), np.asarray(tip.direction)),
                -depth,
                float(np.linalg.norm(total)),
                self._tips.radius,
                middle,
                tuple(np.asarray(tip.axis).tolist()),
                self._tips.half,
            )
            there.append(Touched(slot, self._contact.name, seen))
        return self._bench.pose(loads, state, there, held=held)

    def _check(self, push: Push) -> None:
        most = self._contact.at_once
        if len(push.contacts) > most:
            raise ConfigError(f"{push}: {len(push.contacts)} tips at once: give at most {most}")
        if len(set(push.contacts)) < len(push.contacts):
            raise ConfigError(f"{push}: two tips at one place: give each its own")
        if bool(push.contacts) != bool(push.depths):
            raise ConfigError(f"{push}: {len(push.depths)} depths: give depths with tips, and none without")
        if push.cable < 0 or any(np.diff([0.0, *push.depths]) <= 0):
            raise ConfigError(
                f"{push}: shortening must not be negative, depths must be positive and increase"
            )


def _levels(held: tuple[float, ...], step: float) -> Float[np.ndarray, " n"]:
    """Levels (n,) from the first of the held ones to the last, at most a step apart; no level twice."""
    pieces = [
        np.linspace(a, b, 1 + int(np.ceil((b - a) / step * (1 - 1e-9))))[1:]
        for a, b in zip(held[:-1], held[1:], strict=True)
        if b > a
    ]
    return np.concatenate([held[:1], *pieces])
