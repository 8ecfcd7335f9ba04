"""A robot on which something is done: presses at places, cables shortened or pulled, chambers under pressure.

A cable that is shortened is one whose tension is the multiplier (`ShortenedCable`). What is told of the
equilibrium is that of the cable pulled with that tension, which is the same state of the robot's own model.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import SoftfuseError, SolveError
from softfuse.functional.chart import facing
from softfuse.functional.workspace import nearest_places
from softfuse.io.quantity import FORCE, LENGTH, PRESSURE, Dimension
from softfuse.mechanics.load import AbstractContact, Loads
from softfuse.mechanics.model import Model
from softfuse.mechanics.model import simulate as equilibrium_under
from softfuse.mechanics.solution import Solution, State, result_name
from softfuse.robot.contacts import ContactSettings
from softfuse.robot.names import named_places
from softfuse.robot.posture import Posture, Watched
from softfuse.robot.robot import Robot

_DOWN = (0.0, 0.0, -1.0)
"""Some direction: of places whose point alone matters."""


@dataclass(frozen=True)
class Press:
    """A force [N] of a contact, by name, None for the only one, where: "X,Y" in mm of its chart, "X,Y,Z" in
    mm, carried to the nearest point of the surface, or the name of a place or a point.

    tangential_N: along the tangents u and v of the place, of what is pushed in any direction; depth_m: how
    deep it goes instead of how hard it presses, of what is rigid.
    """

    contact: str | None
    at: str
    force_N: float = 0.0
    tangential_N: tuple[float, float] = (0.0, 0.0)
    depth_m: float | None = None

    def on(self, kind: AbstractContact, name: str) -> tuple[AbstractContact, Float[np.ndarray, " d"]]:
        """The contact of a kind and a name as it is driven, and with what (d,); raises SoftfuseError where it
        cannot be driven so.
        """
        aside = kind.shares == 0
        if any(self.tangential_N) and not aside.any():
            raise SoftfuseError(
                f'the contact "{name}" presses along the normal: only one of model = "force" is pushed aside'
            )
        if self.depth_m is None:
            force = self.force_N * kind.shares
            force[aside] = self.tangential_N if aside.any() else ()
            return kind, force
        deep = kind.at_depth()
        if deep is None:
            raise SoftfuseError(f'the contact "{name}" is not rigid and has no depth: give a force')
        return deep, np.array([self.depth_m])


def presses_of(
    contacts: Sequence[str],
    places: Sequence[str],
    forces_N: Sequence[float] = (),
    depths_mm: Sequence[float] = (),
    tangential_N: Sequence[str] = (),
) -> tuple[Press, ...]:
    """The presses of what is given once for each place, either forces or depths, `contacts` and tangential
    forces "U,V" or none; SoftfuseError where they do not go together.
    """
    count, option = len(places), "--depth" if depths_mm else "--force"
    given = depths_mm or forces_N
    if len(given) != count or (depths_mm and forces_N):
        raise SoftfuseError(
            f"{count} times --at and {len(given)} times {option}: give one of both for each press"
        )
    for name, each in (("--contact", contacts), ("--tangential", tangential_N)):
        if len(each) not in (0, count):
            raise SoftfuseError(f"{len(each)} times {name} for {count} times --at: give one for each")
    names: Sequence[str | None] = contacts or [None] * count
    aside = [_pair(text) for text in tangential_N] or [(0.0, 0.0)] * count
    deep = [1e-3 * depth for depth in depths_mm] or [None] * count
    hard = forces_N or [0.0] * count
    return tuple(
        Press(name, at, force, push, depth)
        for name, at, force, push, depth in zip(names, places, hard, aside, deep, strict=True)
    )


def _pair(text: str) -> tuple[float, float]:
    try:
        u, v = (float(part) for part in text.split(","))
    except ValueError:
        raise SoftfuseError(f'--tangential "{text}": expected two forces in N, U,V') from None
    return u, v


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with contacts at places (c, 3, 3) and what drives it (D,); `robot`: whose it is."""

    robot: Robot
    presses: tuple[Press, ...]
    contacts: tuple[str, ...]
    model: Model
    places: Float[np.ndarray, "c 3 3"]
    drive: Float[Array, " D"]

    @classmethod
    def of(
        cls,
        robot: Robot,
        presses: Sequence[Press] = (),
        cables: Sequence[str] = (),
        pressures: Sequence[str] = (),
    ) -> "Trial":
        """With presses, cables such as "left=10 mm" or "left=2 N", and pressures such as "first=20 kPa";
        without a name where there is only one.

        Raises SoftfuseError for names that there are not, quantities that are none, or a contact off the
        surface.
        """
        settings, kinds, places, contacts, forces = robot.settings, [], [], [], []
        for press in presses:
            contact = _contact(robot, press.contact)
            kind = robot.model.contacts[settings.contacts.index(contact)]
            place = _place(robot, contact, press.at)
            if not kind.stands(robot.model.body, jnp.asarray(place)):
                raise SoftfuseError(_overhangs(robot, contact, place))
            kind, driven = press.on(kind, contact.name)
            kinds.append(kind)
            forces.append(driven)
            places.append(place)
            contacts.append(contact.name)
        given = _given(cables, [each.name for each in settings.cables], "cable", (LENGTH, FORCE))
        driven = [each.name for each in settings.chambers if each.gas == "driven"]
        prescribed = {
            name: value for name, (value, _) in _given(pressures, driven, "pressure", (PRESSURE,)).items()
        }
        for name, (value, _) in given.items():
            if value < 0:
                raise SoftfuseError(f"--cable {name}: a cable is shortened or pulled, from 0 up")
            prescribed[name] = value
        actuators = robot.shortened([name for name, (_, what) in given.items() if what is LENGTH])
        model = replace(
            robot.model, contacts=tuple(kinds), slots=tuple(range(len(kinds))), actuators=actuators
        )
        at = np.array(places).reshape(-1, 3, 3)
        drive = np.array(model.rest_state(jnp.asarray(at)).drive)
        first = sum(len(each) for each in forces)
        drive[:first] = np.concatenate([np.zeros(0), *forces])
        for name, value in prescribed.items():
            drive[first + robot.addresses.drives[name]] = value
        return cls(robot, tuple(presses), tuple(contacts), model, at, jnp.asarray(drive))

    def solved(self) -> Solution:
        """The equilibrium; raises SolveError where none was found."""
        solution = self.searched()
        if not solution.success:
            raise SolveError(self.failure(solution))
        return solution

    @property
    def rest(self) -> State:
        """The body at rest."""
        return self.model.rest_state(jnp.asarray(self.places))

    def searched(self, start: State | None = None) -> Solution:
        """The equilibrium, or the last one on the way to it, from a state or from rest."""
        return equilibrium_under(self.model, jnp.asarray(self.places), self.drive, start)

    def failure(self, solution: Solution) -> str:
        """Why no equilibrium was found, and how far the search came."""
        reached = 100 * float(solution.stats.reached)
        return f"no equilibrium under this: {solution.words}. The search came {reached:.3g} % of the way"

    def numbers(self, solution: Solution) -> dict[str, Any]:
        """What holds in an equilibrium, by names: contacts, cables, chambers, readings, points, bending."""
        robot = self.robot
        model = replace(robot.model, contacts=self.model.contacts, slots=self.model.slots)
        state, at = solution.state, jnp.asarray(self.places)
        # With every cable pulled by its tension.
        state = State(state.z, state.force, *self.model.loads(at).by_force(state.internal, state.drive))
        posture = Watched.on(robot).posture(state)
        drives = robot.addresses.drives
        readings = np.asarray(model.reading(state, at))
        return {
            "contacts": [
                {"contact": name, "at": press.at, "place_mm": _mm(place[0]), **pressed}
                for name, press, place, pressed in zip(
                    self.contacts, self.presses, self.places, self._pressed(state), strict=True
                )
            ],
            "cables": {
                cable.name: {
                    "shortening_mm": 1e3 * float(posture.answers[drives[cable.name]]),
                    "tension_N": float(posture.drives[drives[cable.name]]),
                }
                for cable in robot.settings.cables
            },
            "chambers": {
                chamber.name: {
                    "volume_change_mm3": 1e9 * float(posture.volume_m3[k]),
                    "pressure_Pa": _pressure(chamber.gas, posture, drives.get(chamber.name)),
                }
                for k, chamber in enumerate(robot.settings.chambers)
            },
            "readings": {
                name: {"value": float(value), "unit": unit}
                for name, unit, value in zip(robot.suite.readings, robot.suite.units, readings, strict=True)
            },
            "points_mm": {
                point.name: _mm(place)
                for point, place in zip(robot.settings.points, posture.point_m, strict=True)
            },
            "bend_deg": np.rad2deg(posture.turn).tolist(),
            "tip_bend_deg": float(np.rad2deg(posture.tip_turn)) if posture.turn.size else None,
            "largest_displacement_mm": 1e3 * float(posture.moved_m),
            "nodes": robot.model.body.n_nodes,
            "dof": robot.model.body.n,
            "newton_iterations": int(solution.stats.newton_iterations),
            "residual_N": float(solution.stats.residual),
            "result": result_name(solution.result),
            "reached": float(solution.stats.reached),
            "state": solution.state.lists(),
        }

    def _pressed(self, state: State) -> Iterator[dict[str, Any]]:
        """How hard each contact presses along the normal and aside [N], and how deep."""
        touching = Loads(self.model.loads(jnp.asarray(self.places)).parts[: len(self.places)])
        force, internal = state.force[: touching.sizes.forces], state.internal[: touching.sizes.internal]
        moved = np.asarray(touching.conjugate(force, internal, touching.values(self.model.body, state.z)))
        for press, own, kind in zip(
            self.presses, self.model.owning(len(self.places)).astype(bool), self.model.contacts, strict=True
        ):
            given, answer = np.asarray(state.drive)[: len(moved)][own], moved[own]
            hard, deep = (given, answer) if press.depth_m is None else (answer, given)
            yield {
                "force_N": float(hard[kind.shares > 0].sum()),
                "tangential_N": hard[kind.shares == 0].tolist(),
                "depth_mm": 1e3 * float(kind.shares @ deep),
            }


def told(numbers: Mapping[str, Any]) -> str:
    """An equilibrium's numbers line by line, for people."""
    lines = [
        f"{each['force_N']:g} N of {each['contact']} at {each['at']}: {each['depth_mm']:.4f} mm deep"
        for each in numbers["contacts"]
    ]
    for name, cable in numbers["cables"].items():
        lines.append(
            f"cable {name}: {cable['shortening_mm']:.3f} mm shorter, tension {cable['tension_N']:.4f} N"
        )
    for name, chamber in numbers["chambers"].items():
        gauge = chamber["pressure_Pa"]
        pressure = "" if gauge is None else f", {gauge:.1f} Pa above the atmosphere"
        lines.append(f"chamber {name}: volume change {chamber['volume_change_mm3']:.2f} mm³{pressure}")
    for name, place in numbers["points_mm"].items():
        lines.append(f"{name}: ({', '.join(f'{x:.3f}' for x in place)}) mm")
    if numbers["bend_deg"]:
        bent = ", ".join(f"{angle:.2f}" for angle in numbers["bend_deg"])
        lines.append(f"bending from the base to the tip: {bent} deg")
    lines.append(
        f"largest displacement {numbers['largest_displacement_mm']:.3f} mm ({numbers['nodes']} nodes, "
        f"{numbers['newton_iterations']} iterations)"
    )
    return "\n".join(lines)


def _contact(robot: Robot, name: str | None) -> ContactSettings:
    if not robot.settings.contacts:
        raise SoftfuseError(f"{robot.settings.path}: contact: missing, nothing may press on this robot")
    return robot.settings.contact(name)


def _place(robot: Robot, contact: ContactSettings, at: str) -> Float[np.ndarray, "3 3"]:
    """The place (3, 3) that a text says."""
    places = named_places(robot.settings, contact.name)
    if at in places:
        return places[at]
    chart = robot.parts.contacts[contact.name].chart
    known = {point.name: np.array(point.at) for point in robot.settings.points}
    point = known[at] if at in known else _numbers(at, [*places, *known], chart is not None)
    if chart is not None:
        coordinates = point if point.size == 2 else chart.coordinates(facing(point, _DOWN))
        return np.asarray(chart.place(jnp.asarray(coordinates)))
    rest = np.asarray(robot.model.body.rest)
    return nearest_places(rest, robot.parts.faces, point[None])[0]


def _numbers(at: str, names: Sequence[str], flat: bool) -> Float[np.ndarray, " d"]:
    """X,Y[,Z] in mm as metres."""
    try:
        numbers = 1e-3 * np.array([float(part) for part in at.split(",")])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.size == 3 or (numbers.size == 2 and flat):
        return numbers
    wanted = "X,Y or X,Y,Z" if flat else "X,Y,Z"
    known = f", or a name: {', '.join(names)}" if names else ""
    raise SoftfuseError(f'--at "{at}" is no place of this contact: give {wanted} in mm{known}')


def _overhangs(robot: Robot, contact: ContactSettings, place: Float[np.ndarray, "3 3"]) -> str:
    nodes = 1e3 * np.asarray(robot.model.body.rest)[np.unique(robot.parts.faces)]
    spans = ", ".join(
        f"{a} {low:g} to {high:g}" for a, low, high in zip("xyz", nodes.min(0), nodes.max(0), strict=True)
    )
    at = ", ".join(f"{1e3 * x:g}" for x in place[0])
    return (
        f'the contact "{contact.name}" at ({at}) mm with radius {1e3 * contact.radius:g} mm overhangs the '
        f"surface, which spans {spans} mm: move it inwards"
    )


def _given(
    texts: Sequence[str], names: Sequence[str], option: str, dimensions: Sequence[Dimension]
) -> dict[str, tuple[float, Dimension]]:
    """Quantities by name, and what they are of."""
    found: dict[str, tuple[float, Dimension]] = {}
    listed = ", ".join(f'"{name}"' for name in names)
    for text in texts:
        name, _, value = text.rpartition("=")
        if not names:
            raise SoftfuseError(f"--{option} {text}: this robot has nothing that could be driven so")
        if not name and len(names) == 1:
            name = names[0]
        if name not in names:
            raise SoftfuseError(f'--{option} "{text}": say which one, NAME={value}, with one of {listed}')
        if name in found:
            raise SoftfuseError(f'--{option} "{text}": {name} is given twice')
        found[name] = _quantity(text, value, option, dimensions)
    return found


def _quantity(text: str, value: str, option: str, dimensions: Sequence[Dimension]) -> tuple[float, Dimension]:
    for dimension in dimensions:
        try:
            return dimension.parse(value.strip()), dimension
        except ValueError:
            continue
    wanted = " or ".join(f"{dimension.name} such as NAME={dimension.example}" for dimension in dimensions)
    raise SoftfuseError(f'--{option} "{text}": expected {wanted}')


def _pressure(gas: str, posture: Posture, drive: int | None) -> float | None:
    """Gauge pressure [Pa] of a chamber's gas; None of one that is vented."""
    if drive is None:
        return None
    return float(posture.answers[drive] if gas == "sealed" else posture.drives[drive])


def _mm(place: Float[np.ndarray, "3"]) -> list[float]:
    return [1e3 * float(x) for x in place]
