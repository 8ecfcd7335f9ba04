"""The equilibria that a virtual robot passes through in an episode, and what its sensors could see of each.

First its actuators are driven, in steps; then what touches comes near along its normal, until it lies on the
surface as that is now; then it presses. All is elastic, so that the way back passes through the same
equilibria. Cables that are commanded to a length hold it while something presses, others their tension.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import ConfigError, SolveError
from softfuse.experiment.carried import Carried, Skin
from softfuse.experiment.episodes import Episode, Touch
from softfuse.experiment.pose_cache import Arrays, kept, settings_digest
from softfuse.experiment.virtual_robot import VirtualRobot
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.reading import Equilibrium
from softfuse.mechanics.solution import RESULTS, Solution, State
from softfuse.robot.digest import digest
from softfuse.sensors.parts import TrueContact

log = logging.getLogger(__name__)

_DRIVE_STEPS = 4
"""Equilibria on the way of the actuators."""

_GAPS_M = (60e-3, 40e-3, 25e-3, 14e-3, 8e-3, 4e-3, 2e-3, 1e-3, 0.5e-3, 0.25e-3, 0.0)
"""Heights above the surface at which sensors that see contacts are computed; at the first they lose no more
than noise.
"""

_UNSEEN_GAPS_M = (5e-3, 0.0)
"""Where there are no such sensors."""

_MATTERS = {"body", "environment", "chambers", "cables", "contacts", "sensors", "points"}
"""Settings that equilibria follow from."""


class Touched(NamedTuple):
    """What touches in a slot, of which contact it is, and as sensors see it."""

    slot: int
    contact: str
    seen: TrueContact


class RobotSolver:
    """Equilibria of one virtual robot; a program is compiled for each combination of contacts."""

    def __init__(self, robot: VirtualRobot) -> None:
        """Raises ConfigError for a named point outside the body."""
        made = robot.made
        self._robot, self._made = robot, made
        body = made.parts.body
        self._sees = {sensor.name: sensor.contact for sensor in made.suite.contact_sensors}
        self._seeing = [sensor for sensor in made.settings.sensors if sensor.name in self._sees]
        with robot.drawn.told("point"):
            drawn = np.array([point.at for point in robot.drawn.points]).reshape(-1, 3)
            self._points = Carried.of(body, drawn)
        self.gaps = _GAPS_M if self._seeing else _UNSEEN_GAPS_M
        self._nodes = jax.jit(lambda z: body.rest + body.displacement(z))
        chambers = [chamber.cavity for chamber in made.parts.chambers.values()]
        self._volumes = jax.jit(lambda x: jnp.array([cavity(x) for cavity in chambers]))
        self._rest_volumes = np.asarray(self._volumes(body.rest))

    @cached_property
    def _watched(self) -> list[Carried]:
        """What sensors that see contacts want to be followed; only needed where something is solved."""
        parts = self._made.parts
        return [Carried.of(parts.body, sensor.points(parts)) for sensor in self._seeing]

    def poses(self, episode: Episode, *, solved: Callable[[], None] | None = None) -> Arrays:
        """The n equilibria of an episode in order: rest, actuators' way, contacts at their gaps, forces.

        Arrays, c slots of contacts, a drives of actuators: `reading` (n, k) SI; `signal <sensor>` (n, e),
        what those that see contacts say; `force` (n, c) N; `gap` (n, c) m, below 0 by how deep it is pressed
        in; `point` (n, p, 3) m; `drive`, `answer` (n, a) SI, tensions and shortenings of cables; `volume` (n,
        h) m³ changes of chambers; `held` (n,) 1 where it rests for a sample, else 0. `solved` is called after
        each equilibrium. Raises ConfigError for a contact or actuator that there is not, or a disc that
        overhangs, SolveError when an equilibrium is not found.
        """
        done = solved or (lambda: None)
        touches, slots = episode.touches, self._slots(episode)
        radii = [self._made.parts.contacts[touch.contact].radius for touch in touches]
        poses: list[Mapping[str, np.ndarray]] = []
        faces = np.asarray(self._made.parts.faces)
        under = [Skin.under(self._made.parts.body, faces, np.array(touch.place)) for touch in touches]
        level = np.zeros(len(touches))

        def pose(
            model: Model, state: State, gaps: np.ndarray, forces: np.ndarray, *, held: bool = False
        ) -> None:
            nodes = self.nodes(state)
            there = [
                Touched(slot, touch.contact, skin.touched(nodes, float(gap), float(force), radius))
                for slot, touch, skin, gap, force, radius in zip(
                    slots, touches, under, gaps, forces, radii, strict=True
                )
            ]
            contacts = self._places(touches)[: len(model.contacts)]
            poses.append(self.pose(model.loads(contacts), state, there, held=held))

        drive = self._rest_drive()
        away = np.full(len(touches), self.gaps[0])
        # Without any load there is no search: then contacts lie on from the start.
        free = self.model(() if self._made.model.actuators else touches)
        places = self._places(touches)[: len(free.contacts)]
        state = State.rest(free.body, free.loads(places))
        if any(self._made.settings.environment.gravity):
            state = self._found(free, places, state.drive, state, f"{episode}: at rest")
        pose(free, state, away, level)
        target = self._driven(episode, drive)
        if np.any(target != drive):
            for share in np.arange(1, _DRIVE_STEPS + 1) / _DRIVE_STEPS:
                to = jnp.asarray(drive + share * (target - drive))
                state = self._found(free, places, to, state, f"{episode}: on the way there")
                pose(free, state, away, level, held=not touches and share == 1)
                done()
        if not touches:
            return stacked(poses)
        model, places = self.model(touches), self._places(touches)
        for touch, place, contact in zip(touches, places, model.contacts, strict=True):
            if not contact.stands(model.body, place):
                raise ConfigError(f"{touch} overhangs the edge of the body: move it inwards")
        state = _touching(model, places, state)
        for gap in self.gaps[1:]:
            pose(model, state, np.full(len(touches), gap), level)
        depth = np.asarray(model.depths(places, state))
        for forces in zip(*(touch.forces for touch in touches), strict=True):
            to = state.drive.at[: len(touches)].set(jnp.array(forces))
            where = f"{episode}: under {', '.join(f'{force:.3g}' for force in forces)} N"
            state = self._found(model, places, to, state, where)
            sunk = np.asarray(model.depths(places, state)) - depth
            pose(model, state, -sunk, np.array(forces), held=True)
            done()
        return stacked(poses)

    def count(self, episode: Episode) -> int:
        """How many equilibria `poses` tells of by `solved`."""
        levels = len(episode.touches[0].forces) if episode.touches else 0
        driven = any(value for _, value in episode.driven)
        return levels + _DRIVE_STEPS * driven

    def reach(self) -> tuple[tuple[str, float], ...]:
        """The most that each actuator is driven to, as an `Episode` has it: the highest pressure; a cable's
        largest tension, or how far that shortens it by itself, or as far as the body bears it.
        """
        settings, reach = self._made.settings, []
        for number, cable in enumerate(settings.cables):
            most = cable.max_tension
            if cable.name in self._by_length:
                model, drive = self._made.model, jnp.asarray(self._rest_drive())
                model = replace(model, contacts=(), slots=())
                nowhere = jnp.zeros((0, 3, 3))
                start = State.rest(model.body, model.loads(nowhere))
                found = simulate(model, nowhere, drive.at[number].set(most), start)
                if not float(found.stats.reached) > 0:
                    raise _no_equilibrium(f'"{cable.name}" pulled', found)
                most = float(model.answers(found.state)[number])
            reach.append((cable.name, most))
        reach += [(each.name, each.highest) for each in settings.chambers if each.highest is not None]
        return tuple(reach)

    @property
    def _by_length(self) -> list[str]:
        """The cables that are commanded to a length, or to nothing."""
        cables = self._made.settings.cables
        return [each.name for each in cables if each.command is None or each.command.of == "length"]

    def model(self, touches: Sequence[Touch]) -> Model:
        """The body under some contacts, its cables shortened where they are commanded so."""
        made, names = self._made, [contact.name for contact in self._made.settings.contacts]
        contacts = tuple(made.model.contacts[names.index(touch.contact)] for touch in touches)
        return Model(
            made.model.body,
            made.model.readings,
            contacts,
            made.model.linear,
            made.shortened(self._by_length),
            tuple(range(len(contacts))),
        )

    def _slots(self, episode: Episode) -> list[int]:
        """The slot of each touch."""
        taken, found = dict[str, int](), []
        for touch in episode.touches:
            own = self._made.addresses.slots.get(touch.contact)
            used = taken.get(touch.contact, 0)
            if own is None or used >= own.stop - own.start:
                raise ConfigError(f"{episode}: there are not so many contacts at once")
            taken[touch.contact] = used + 1
            found.append(own.start + used)
        return found

    @staticmethod
    def _places(touches: Sequence[Touch]) -> Float[Array, "t 3 3"]:
        return jnp.array([touch.place for touch in touches]).reshape(-1, 3, 3)

    def _rest_drive(self) -> Float[np.ndarray, " a"]:
        """Neither tensions nor shortenings, gas as it was sealed, no pressures."""
        actuators = self._made.model.actuators
        return np.asarray(Loads(actuators).start()[2]) if actuators else np.zeros(0)

    def _driven(self, episode: Episode, rest: Float[np.ndarray, " a"]) -> Float[np.ndarray, " a"]:
        target = rest.copy()
        known = {cable.name for cable in self._made.settings.cables}
        known |= {each.name for each in self._made.settings.chambers if each.gas == "driven"}
        for name, value in episode.driven:
            if name not in known:
                raise ConfigError(f'{episode}: there is no cable or driven chamber "{name}"')
            target[self._made.addresses.drives[name]] = value
        return target

    def _found(self, model: Model, places: Array, drive: Array, state: State, where: str) -> State:
        found = simulate(model, places, drive, state)
        if not bool(found.result == RESULTS.converged):
            raise _no_equilibrium(where, found)
        log.info("%s: %d iterations", where, int(found.stats.newton_iterations))
        return found.state

    def nodes(self, state: State) -> Float[np.ndarray, "k 3"]:
        """Where all nodes (k, 3) are in a state [m]."""
        return np.asarray(self._nodes(state.z))

    def pose(
        self, loads: Loads, state: State, there: Sequence["Touched"], *, held: bool = False
    ) -> dict[str, np.ndarray]:
        """What there is to be seen of an equilibrium under loads, those of contacts first, see `poses`."""
        made, nodes = self._made, self.nodes(state)
        contacts = Loads(loads.parts[: len(loads.parts) - len(made.model.actuators)])
        # As one of pulled cables, whose tension is the drive.
        state = State(state.z, state.force, *loads.by_force(state.internal, state.drive))
        reading, drive, answer = _measured(made.model, contacts, state)
        force, gap = np.zeros(len(made.workspaces)), np.full(len(made.workspaces), self.gaps[0])
        for each in there:
            force[each.slot], gap[each.slot] = each.seen.force, each.seen.gap
        pose = {
            "reading": np.asarray(reading),
            "force": force,
            "gap": gap,
            "point": self._points.at(nodes),
            "drive": np.asarray(drive),
            "answer": np.asarray(answer),
            "volume": np.asarray(self._volumes(jnp.asarray(nodes))) - self._rest_volumes,
            "held": np.asarray(float(held)),
        }
        for sensor, carried in zip(self._seeing, self._watched, strict=True):
            seen = [each.seen for each in there if each.contact == self._sees[sensor.name]]
            pose[f"signal {sensor.name}"] = np.asarray(sensor.signal(made.parts, seen, carried.at(nodes)))
        return pose


def _no_equilibrium(where: str, found: Solution) -> SolveError:
    return SolveError(
        f"{where}: no equilibrium: {RESULTS[found.result]}; press less hard, or drive it less far"
    )


@eqx.filter_jit
def _measured(model: Model, contacts: Loads, state: State) -> tuple[Array, Array, Array]:
    """Readings (k,), drives and answers (a,) of the actuators."""
    at = Equilibrium(model.body, contacts, Loads(model.actuators), state)
    return jnp.concatenate([jnp.zeros(0), *(each.of(at) for each in model.readings)]), at.drives, at.answers


def _touching(model: Model, places: Array, state: State) -> State:
    """A state of the actuators alone with contacts that lie on without force."""
    fresh = State.rest(model.body, model.loads(places))

    def after(new: Array, old: Array) -> Array:
        return jnp.concatenate([new[: len(new) - len(old)], old])

    if len(state.drive) == len(fresh.drive):
        return state
    return State(
        state.z,
        after(fresh.force, state.force),
        after(fresh.internal, state.internal),
        after(fresh.drive, state.drive),
    )


def stacked(poses: Sequence[Mapping[str, np.ndarray]]) -> Arrays:
    return {name: np.stack([pose[name] for pose in poses]) for name in poses[0]}


def kept_poses(
    folder: Path | None,
    robot: VirtualRobot,
    episodes: Sequence[Episode],
    *,
    solved: Callable[[], None] | None = None,
) -> list[Arrays]:
    """The equilibria of each episode, see `RobotSolver.poses`, from the folder those that are there; None:
    computed and not kept. `solved` is called after each equilibrium that is computed.
    """
    made = digest(robot.drawn, _MATTERS), robot.errors
    files = [f"robot-{settings_digest(*made, episode)}" for episode in episodes]

    def start() -> Callable[[int], Arrays]:
        solver = RobotSolver(robot)
        return lambda k: solver.poses(episodes[k], solved=solved)

    return kept(folder, files, arrays_of(robot), start)


def arrays_of(robot: VirtualRobot) -> frozenset[str]:
    """The names of the arrays of `RobotSolver.poses`."""
    seen = {f"signal {sensor.name}" for sensor in robot.made.suite.contact_sensors}
    return frozenset({"reading", "force", "gap", "point", "drive", "answer", "volume", "held"} | seen)
