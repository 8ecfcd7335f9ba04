"""What is done to a virtual robot: its actuators are driven, then something presses, harder and harder.

An episode begins and ends at rest, with nothing near.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import ConfigError
from softfuse.functional.chart import moved
from softfuse.robot.robot import Robot

Place = tuple[tuple[float, float, float], ...]
"""Point [m] and tangents of a place, see `functional.chart`."""

_LEVELS = (1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Forces that are held, as parts of the largest."""

_HARDEST = (0.35, 0.75)
"""Range of that, as a part of the largest that the contact is made for."""

_DRIVEN = 0.5
"""Of what actuators can do: as far as they are driven."""

_APART = 4.0
"""Radii between the middles of two that press at once."""

_TRIES = 100


@dataclass(frozen=True)
class Touch:
    """What presses: its contact, its place on the body at rest, increasing forces [N] at which it rests."""

    contact: str
    place: Place
    forces: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.forces or any(b <= a for a, b in zip((0.0, *self.forces), self.forces, strict=False)):
            raise ConfigError(f"forces {self.forces} N: give positive ones that increase")

    def __str__(self) -> str:
        return f'"{self.contact}" at ({", ".join(f"{1e3 * x:.3g}" for x in self.place[0])}) mm'


@dataclass(frozen=True)
class Episode:
    """Touches at once, with as many forces each, and to what actuators are driven before, by their name: a
    cable to a shortening [m] or tension [N], whichever it is commanded to, a shortening where it is not; a
    chamber to a gauge pressure [Pa]. What is not named stays as it is at rest.
    """

    touches: tuple[Touch, ...] = ()
    driven: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        if len({len(touch.forces) for touch in self.touches}) > 1:
            raise ConfigError(f"{self}: touches at once have as many forces each")

    def __str__(self) -> str:
        driven = [f'"{name}" driven to {value:.4g}' for name, value in self.driven]
        return " and ".join((*map(str, self.touches), *driven)) or "nothing"


def episodes_of(
    robot: Robot, count: int, *, reach: Sequence[tuple[str, float]], seed: int
) -> tuple[Episode, ...]:
    """So many episodes at random: each touches anywhere that contacts may press, every other one drives
    actuators too, all do where nothing may press; every third has as many touches at once as the contact has.

    reach: the most that each actuator is driven to, see `RobotSolver.reach`.
    """
    rng = np.random.default_rng(seed)
    contacts = robot.settings.contacts
    if not contacts and not reach:
        raise ConfigError(f"{robot.settings.path}: nothing may press and nothing is driven: add [[contact]]")
    found = []
    for k in range(count):
        driven: tuple[tuple[str, float], ...] = ()
        if k % 2 == 1 or not contacts:
            driven = tuple((name, float(_DRIVEN * rng.uniform() * most)) for name, most in reach)
        touches: tuple[Touch, ...] = ()
        if contacts:
            contact = contacts[k % len(contacts)]
            at_once = contact.at_once if k % 3 == 2 else 1
            hardest = rng.uniform(*_HARDEST, at_once) * contact.max_force
            places = _places(robot, contact.name, at_once, _APART * contact.radius, rng)
            touches = tuple(
                Touch(contact.name, place_of(place), tuple(float(level * force) for level in _LEVELS))
                for place, force in zip(places, hardest, strict=True)
            )
        found.append(Episode(touches, driven))
    return tuple(found)


def place_of(place: Float[np.ndarray, "3 3"]) -> Place:
    """A place (3, 3) as an episode has it."""
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(place).tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def _places(
    robot: Robot, contact: str, count: int, apart: float, rng: np.random.Generator
) -> list[Float[np.ndarray, "3 3"]]:
    """Places (3, 3) of a contact, so far apart [m]."""
    for _ in range(_TRIES):
        places = [_place(robot, contact, rng) for _ in range(count)]
        points = np.stack([place[0] for place in places])
        distance = np.linalg.norm(points[:, None] - points, axis=-1) + apart * np.eye(count)
        if distance.min() >= apart:
            return places
    raise ConfigError(
        f'{robot.settings.path}: contact "{contact}": there is no room for {count} at once: lower at_once'
    )


def _place(robot: Robot, contact: str, rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """A place (3, 3) at random where it may press: in its workspace, or on an electrode."""
    workspace = robot.workspaces[robot.addresses.slots[contact].start]
    if workspace is not None:
        return workspace.drawn(rng)
    for sensor in robot.settings.sensors:
        places = [seen for seen in sensor.places if seen.contact == contact]
        if places:
            seen = places[rng.integers(len(places))]
            half = np.sqrt(3.0 * np.diagonal(seen.covariance))
            # Most of an electrode's length, not its edges, where its neighbour may see more of it.
            return moved(seen.place, 0.7 * rng.uniform(-half, half))
    raise ConfigError(
        f'{robot.settings.path}: contact "{contact}": nobody says where it may press: give it a surface, '
        "or electrodes"
    )
