"""Pushes on a virtual finger: the equilibria that it passes through.

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

from softfuse.body.body import Body
from softfuse.errors import ConfigError, SolveError
from softfuse.experiment.virtual_finger import Side, VirtualFinger, rigid_tip, seen_from, set_against
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import Loads
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.rigid_cylinder import RigidCylinder
from softfuse.mechanics.solution import RESULTS, State

log = logging.getLogger(__name__)

CONTACTS = 2
"""Largest number of tips that push at once."""

_LENGTHS_AWAY = 2.0
"""Lengths of the finger by which the tips stand back while the cable alone moves it."""

_HALVINGS = 5
"""How often a step between two equilibria may be halved."""

_TOUCHING_N = 1e-6
"""Total force below which a contact has no centre of pressure [N]."""


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
    """Largest steps in m between equilibria, of cable and tips, and how far from the finger tips wait."""

    cable: float = 2.5e-3
    depth: float = 2.5e-3
    clearance: float = 30e-3


@dataclass(frozen=True, eq=False)
class Pose:
    """What a test bed sees of equilibria; leading axes *n: none for a single one.

    cable [m]: shortening; depth [m]: of the tips beyond first contact, negative before; points (p, 3) and
    electrodes (e, g, 3) [m]: where they are; gauge (k,) [Pa]: pressures; tension [N]; of each of `CONTACTS`
    tips the magnitude of its force (c,) [N], the centre of pressure (c, 3) [m], without force the middle of
    the patch that the tip can meet, and its middle (c, 3) [m] and axis (c, 3), 0 where there is no tip.
    """

    cable: Float[np.ndarray, "*n"]
    depth: Float[np.ndarray, "*n"]
    points: Float[np.ndarray, "*n p 3"]
    electrodes: Float[np.ndarray, "*n e g 3"]
    gauge: Float[np.ndarray, "*n k"]
    tension: Float[np.ndarray, "*n"]
    force: Float[np.ndarray, "*n c"]
    contact: Float[np.ndarray, "*n c 3"]
    tip: Float[np.ndarray, "*n c 3"]
    axis: Float[np.ndarray, "*n c 3"]


def cable_levels(push: Push, steps: Steps) -> Float[np.ndarray, " n"]:
    """Shortenings (n,) m on the way from 0 to the push's."""
    return _levels((0.0, push.cable), steps.cable)


def depth_levels(push: Push, steps: Steps) -> Float[np.ndarray, " n"]:
    """Depths (n,) m on the way from 0 through all that are held."""
    return _levels((0.0, *push.depths), steps.depth)


def equilibria(push: Push, steps: Steps) -> int:
    """How many equilibria `FingerSolver.poses` solves for."""
    return len(cable_levels(push, steps)) + len(depth_levels(push, steps)) - 2


class FingerSolver:
    """Equilibria of one virtual finger; a program is compiled for each number of tips."""

    def __init__(
        self,
        finger: VirtualFinger,
        steps: Steps,
        *,
        plan: Callable[[Body], AbstractLinearSolver] = Multifrontal.plan,
    ) -> None:
        """A solver that goes from one equilibrium to the next in `steps`; plan: of its linear solver."""
        self._finger = finger
        self._steps = steps
        self._newton = Newton(plan(finger.body))
        self._solve = eqx.filter_jit(solve)

    def poses(self, push: Push, *, solved: Callable[[], None] | None = None) -> list[Pose]:
        """The poses of a push, in order: rest and cable with the tips waiting, first contact, the depths.

        `solved` is called after each equilibrium. Raises ConfigError for tips or depths that make no push,
        SolveError when an equilibrium is not found.
        """
        _check(push)
        finger = self._finger
        tips = tuple(rigid_tip(finger, *place) for place in push.contacts)
        loads = Loads((*tips, finger.cable, finger.gas))
        state = State.rest(finger.body, loads)
        away = np.full(len(tips), -_LENGTHS_AWAY * finger.settings.drawing.size[0])
        under_cable = [state]
        for shortening in cable_levels(push, self._steps)[1:]:
            drive = self._drive(loads, away, shortening)
            where = f"{push}: on the way, at {1e3 * shortening:g} mm"
            under_cable.append(self._next(tips, loads, under_cable[-1], drive, where))
            if solved is not None:
                solved()
        state = under_cable[-1]
        placed = [
            set_against(tip, _patch(finger, tip, state).reshape(*finger.settings.patch_points, 3))
            for tip in tips
        ]
        tips = tuple(tip for tip, _ in placed)
        first = np.array([advance for _, advance in placed])
        waiting = -self._steps.clearance
        levels = cable_levels(push, self._steps)
        poses = [
            _pose(finger, tips, first, at, shortening, waiting)
            for at, shortening in zip(under_cable, levels, strict=True)
        ]
        if not tips:
            return poses
        # First contact without force is the equilibrium of the cable alone, with the tips there.
        loads = Loads((*tips, finger.cable, finger.gas))
        state = eqx.tree_at(lambda s: s.drive, state, self._drive(loads, first, push.cable))
        poses.append(_pose(finger, tips, first, state, push.cable, 0.0))
        for depth in depth_levels(push, self._steps)[1:]:
            drive = self._drive(loads, first + depth, push.cable)
            state = self._next(tips, loads, state, drive, f"{push}: at a depth of {1e3 * depth:g} mm")
            poses.append(_pose(finger, tips, first, state, push.cable, depth))
            if solved is not None:
                solved()
        return poses

    def _drive(self, loads: Loads, advance: Float[np.ndarray, " t"], shortening: float) -> Float[Array, " d"]:
        """All drives: tips (t,) m, cable in m, gas as sealed at rest."""
        filling = loads.start()[2][len(advance) + 1 :]
        return jnp.concatenate([jnp.asarray(advance, float), jnp.array([float(shortening)]), filling])

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
            found = self._solve(self._newton, self._finger.body, loads, ahead[-1], state)
            iterations += int(found.stats.newton_iterations)
            converged = bool(found.result == RESULTS.converged)
            if converged and not passed_through(self._finger, tips, found.state):
                state = found.state
                ahead.pop()
            elif len(ahead) <= _HALVINGS:
                ahead.append(0.5 * (state.drive + ahead[-1]))
            else:
                why = "a tip passes through the finger" if converged else RESULTS[found.result]
                raise SolveError(f"{where}: no equilibrium: {why}; push less deep, or with other tips")
        log.info("%s: %d iterations", where, iterations)
        return state


def passed_through(finger: VirtualFinger, tips: tuple[RigidCylinder, ...], state: State) -> bool:
    """Whether a tip has left points of the skin behind it that it should have pushed on: the law of contact
    knows the distance from its axis only, and is content with those behind.
    """
    for tip, drive in zip(tips, np.asarray(state.drive), strict=False):
        centre = np.asarray(tip.centre + drive * tip.direction)
        ahead, aside = seen_from(tip, centre, _patch(finger, tip, state))
        if np.any((aside < float(tip.radius)) & (ahead < 0.0)):
            return True
    return False


def _check(push: Push) -> None:
    if len(push.contacts) > CONTACTS:
        raise ConfigError(f"{push}: {len(push.contacts)} tips at once: give at most {CONTACTS}")
    if len(set(push.contacts)) < len(push.contacts):
        raise ConfigError(f"{push}: two tips at one place: give each its own")
    if bool(push.contacts) != bool(push.depths):
        raise ConfigError(f"{push}: {len(push.depths)} depths: give depths with tips, and none without")
    if push.cable < 0 or any(np.diff([0.0, *push.depths]) <= 0):
        raise ConfigError(f"{push}: shortening must not be negative, depths must be positive and increase")


def _levels(held: tuple[float, ...], step: float) -> Float[np.ndarray, " n"]:
    """Levels (n,) from the first of the held ones to the last, at most a step apart; no level twice."""
    pieces = [
        np.linspace(a, b, 1 + int(np.ceil((b - a) / step * (1 - 1e-9))))[1:]
        for a, b in zip(held[:-1], held[1:], strict=True)
        if b > a
    ]
    return np.concatenate([held[:1], *pieces])


def _patch(finger: VirtualFinger, tip: RigidCylinder, state: State) -> Float[np.ndarray, "m 3"]:
    """Where the points are that a tip can meet (m, 3) m."""
    return np.asarray(tip.ports.values(finger.body, state.z)).reshape(-1, 3)


def _pose(
    finger: VirtualFinger,
    tips: tuple[RigidCylinder, ...],
    first: Float[np.ndarray, " t"],
    state: State,
    shortening: float,
    depth: float,
) -> Pose:
    nodes = np.asarray(finger.body.rest + finger.body.displacement(state.z))
    forces, internal = np.asarray(state.force), np.asarray(state.internal)
    force = np.zeros(CONTACTS)
    contact, middle, axis = np.zeros((3, CONTACTS, 3))
    start = 0
    for k, tip in enumerate(tips):
        x = _patch(finger, tip, state)
        pushes = internal[start : start + len(x)]
        force[k] = np.linalg.norm(forces[3 * start : 3 * (start + len(x))].reshape(-1, 3).sum(axis=0))
        contact[k] = pushes @ x / pushes.sum() if force[k] > _TOUCHING_N else x.mean(axis=0)
        middle[k] = np.asarray(tip.centre) + (first[k] + depth) * np.asarray(tip.direction)
        axis[k] = np.asarray(tip.axis)
        start += len(x)
    cavities = len(finger.gas.rest)
    return Pose(
        cable=np.asarray(shortening, float),
        depth=np.asarray(depth, float),
        points=finger.points.at(nodes),
        electrodes=finger.electrodes.at(nodes).reshape(-1, finger.electrode_points, 3),
        gauge=forces[-cavities:],
        tension=internal[start],
        force=force,
        contact=contact,
        tip=middle,
        axis=axis,
    )
