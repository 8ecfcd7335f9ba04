"""What a sweep varies, as a TOML file: places, forces or depths, numbers of contacts, what actuators do,
factors of all moduli.

Every combination is a case. Forces and depths are swept from the lowest up at each place, so that each
equilibrium is searched from the one before.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Annotated, Generic, Literal, Self, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Le, Len
from pydantic import BeforeValidator, Field, model_validator

from softfuse.errors import ConfigError
from softfuse.io.quantity import (
    Force,
    Integer,
    Length,
    PositiveInteger,
    PositiveNumber,
    Pressure,
    wrong_value,
)
from softfuse.io.settings import Ascending, FileSettings, NotEmpty, Range, Settings, listed
from softfuse.robot.contacts import WorkspaceSettings
from softfuse.robot.file import file_text, validated
from softfuse.robot.names import named_places
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings

Quantity = TypeVar("Quantity", bound=float)

MOST_CONTACTS = 4
MOST_CASES = 1_000_000
_TRIES = 10_000
"""Draws of random places for a case, until they are far enough apart."""

Middle = tuple[float, ...]
"""Of what presses: x and y [m] in the chart of a flat workspace; x, y and z on any other surface."""


class Levels(Settings, Generic[Quantity]):
    """Ascending values in SI: a list of them, or `count` evenly spaced ones `from` one `to` another."""

    values: Annotated[tuple[Quantity, ...], NotEmpty, Ascending] | None = None
    first: Quantity | None = Field(default=None, alias="from")
    last: Quantity | None = Field(default=None, alias="to")
    count: Annotated[Integer, Ge(2)] | None = None

    @property
    def all(self) -> tuple[float, ...]:
        """All values (m,)."""
        if self.values is not None:
            return self.values
        assert self.first is not None and self.last is not None and self.count is not None
        return tuple(np.linspace(self.first, self.last, self.count).tolist())

    @model_validator(mode="after")
    def _check(self) -> Self:
        ends = (self.first, self.last, self.count)
        if (self.values is None) == (ends == (None, None, None)) or (self.values is None and None in ends):
            raise wrong_value("give either values, a list, or from, to and count")
        if self.first is not None and self.last is not None and self.last <= self.first:
            raise wrong_value("must be above from", key="to")
        return self


Forces = Levels[Annotated[Force, Ge(0)]]
Lengths = Levels[Annotated[Length, Ge(0)]]
Pressures = Levels[Pressure]


class MiddlePlaces(Settings):
    """Middles of contacts; those of a case are at least `apart` m from each other, None: two radii."""

    apart: Annotated[Length, Gt(0)] | None = None

    def sets(self, plan: "SweepPlan", config: RobotSettings) -> list[tuple[Middle, ...]]:
        """The places [m] of each case of a plan. Raises ConfigError when they do not suit the robot."""
        contact = config.contact(plan.contact)
        apart = 2 * contact.radius if self.apart is None else self.apart
        if contact.within is not None:
            return self.within(contact.within, apart, plan)
        if contact.surface is None:
            raise ConfigError(
                f'{plan.path}: places.type: this robot is pressed at its electrodes: give "electrodes"'
            )
        return self.over(config, apart, plan)

    @abstractmethod
    def within(
        self, workspace: WorkspaceSettings, apart: float, plan: "SweepPlan"
    ) -> list[tuple[Middle, ...]]:
        """Those in a flat workspace, so far apart [m]."""

    def over(self, config: RobotSettings, apart: float, plan: "SweepPlan") -> list[tuple[Middle, ...]]:
        """Those on the surface of a robot's contact, so far apart [m]."""
        raise ConfigError(
            f'{plan.path}: places.type: this contact may be anywhere on a surface: give "surface" or "list"'
        )


class SurfacePlaces(MiddlePlaces):
    """count places well spread over the part of the surface where the contact may be, None: all that an
    estimate looks at. Of several contacts, all sets of as many that are far enough apart.
    """

    type: Literal["surface"]
    count: PositiveInteger | None = None

    def within(self, workspace, apart, plan):
        """None."""
        raise ConfigError(
            f'{plan.path}: places.type: this is pressed in a workspace: give "grid", "random" or "list"'
        )

    def over(self, config, apart, plan):
        """Each is furthest from those before it."""
        robot = build_robot(config)
        workspace = robot.workspaces[robot.addresses.slots[config.contact(plan.contact).name].start]
        assert workspace is not None  # its contact has a surface
        points = workspace.grid(0)[0][: self.count, 0]
        return _sets_apart([tuple(point) for point in points.tolist()], apart, plan)


class GridPlaces(MiddlePlaces):
    """count places along x and along y over ranges in m, their ends included; None: those of the workspace.

    Of several contacts, all sets of as many places that are far enough apart.
    """

    type: Literal["grid"]
    count: tuple[PositiveInteger, PositiveInteger]
    x: Range | None = None
    y: Range | None = None

    def within(self, workspace, apart, plan):
        """By y, then by x."""
        (x, y), (across, along) = _ranges(self, plan, workspace), self.count
        return _sets_apart([(a, b) for b in _spread(y, along) for a in _spread(x, across)], apart, plan)


class RandomPlaces(MiddlePlaces):
    """count sets of as many places as there are contacts, each place evenly distributed over the ranges in m.

    The same seed gives the same places.
    """

    type: Literal["random"]
    count: PositiveInteger
    seed: Annotated[Integer, Ge(0)] = 0
    x: Range | None = None
    y: Range | None = None

    def within(self, workspace, apart, plan):
        """As many for each number of contacts."""
        check_count(plan, len(plan.contacts) * self.count * len(plan.levels))
        x, y = _ranges(self, plan, workspace)
        low, size = np.array([x[0], y[0]]), np.array([x[1] - x[0], y[1] - y[0]])
        sets = list[tuple[Middle, ...]]()
        for contacts in plan.contacts:
            generator = np.random.Generator(np.random.PCG64([self.seed, contacts]))

            def draw(random=generator, shape=(contacts, 2)) -> tuple[Middle, ...]:
                return tuple((a, b) for a, b in (low + size * random.random(shape)).tolist())

            for _ in range(self.count):
                tries = (draw() for _ in range(_TRIES))
                found = next((each for each in tries if _are_apart(each, apart)), None)
                if found is None:
                    raise ConfigError(
                        f"{plan.path}: places.apart: {contacts} places {1e3 * apart:g} mm apart do not fit: "
                        "give fewer contacts or a smaller distance"
                    )
                sets.append(found)
        return sets


class ListedPlaces(MiddlePlaces):
    """Places (p, 2) m in a flat workspace, or points (p, 3) m, of which the nearest of the surface are meant;
    of several contacts, all sets of as many that are far enough apart.
    """

    type: Literal["list"]
    at: Annotated[tuple[Annotated[tuple[Length, ...], Len(2, 3)], ...], NotEmpty]

    def within(self, workspace, apart, plan):
        """As listed."""
        self._check(plan, 2)
        for k, place in enumerate(self.at):
            key = f"{plan.path}: places.at[{k}]"
            for value, axis in zip(place, "xy", strict=True):
                low, high = allowed = getattr(workspace, axis)
                if not low <= value <= high:
                    raise ConfigError(f"{key}: {axis} is beyond contact.workspace, {_millimetres(allowed)}")
        return _sets_apart(self.at, apart, plan)

    def over(self, config, apart, plan):
        """As listed."""
        del config
        self._check(plan, 3)
        return _sets_apart(self.at, apart, plan)

    def _check(self, plan: "SweepPlan", coordinates: int) -> None:
        for k, place in enumerate(self.at):
            key = f"{plan.path}: places.at[{k}]"
            if len(place) != coordinates:
                wanted = "x and y in the workspace" if coordinates == 2 else "x, y and z of a point"
                raise ConfigError(f"{key}: give {wanted}")
            if place in self.at[:k]:
                raise ConfigError(f"{key}: this place is given twice")


class ElectrodePlaces(Settings):
    """Electrodes that are pressed, None: each; of several contacts, all sets of as many different ones."""

    type: Literal["electrodes"]
    names: Annotated[tuple[str, ...], NotEmpty] | None = None

    def sets(self, plan: "SweepPlan", config: RobotSettings) -> list[tuple[str, ...]]:
        """The electrodes of each case of a plan. Raises ConfigError when they do not suit the robot."""
        if config.contact(plan.contact).within is not None:
            raise ConfigError(
                f'{plan.path}: places.type: this is pressed in a workspace: give "grid", "random" or "list"'
            )
        known = list(named_places(config, config.contact(plan.contact).name))
        names = known if self.names is None else self.names
        for k, name in enumerate(names):
            key = f"{plan.path}: places.names[{k}]"
            if name not in known:
                quoted = ", ".join(f'"{each}"' for each in known)
                raise ConfigError(f'{key}: there is no electrode "{name}": give some of {quoted}')
            if name in names[:k]:
                raise ConfigError(f'{key}: the electrode "{name}" is given twice')
        if plan.contacts[-1] > len(names):
            raise ConfigError(
                f"{plan.path}: contacts: {plan.contacts[-1]} at once on {len(names)} electrodes"
            )
        return [each for count in plan.contacts for each in combinations(names, count)]


AnyPlaces = Annotated[
    GridPlaces | RandomPlaces | ListedPlaces | SurfacePlaces | ElectrodePlaces, Field(discriminator="type")
]


class CableLevels(Settings):
    """By how much (m) a cable is shortened, or with which tension (N) it is pulled."""

    name: str
    shortening: Lengths | None = None
    tension: Forces | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.shortening is None) == (self.tension is None):
            raise wrong_value("give either shortening or tension")
        return self


class ChamberLevels(Settings):
    """Gauge pressures (Pa) to which a chamber is driven."""

    name: str
    pressure: Pressures


class SweepPlan(FileSettings):
    """A validated plan, in SI.

    contact: which one presses, None: the only one; forces, or how deep it goes: of each; contacts: how many
    at once; without places nothing presses; cables that are not named hang slack, chambers are as the
    atmosphere is; modulus_factors: of all moduli of all materials; cases_per_file: about as many are solved
    in one go.
    """

    contact: str | None = None
    places: AnyPlaces | None = None
    forces: Forces | None = None
    depths: Lengths | None = None
    contacts: Annotated[
        tuple[Annotated[Integer, Ge(1), Le(MOST_CONTACTS)], ...],
        NotEmpty,
        Ascending,
        BeforeValidator(listed),
    ] = (1,)
    cables: tuple[CableLevels, ...] = Field(default=(), alias="cable")
    chambers: tuple[ChamberLevels, ...] = Field(default=(), alias="chamber")
    modulus_factors: Annotated[tuple[PositiveNumber, ...], NotEmpty, Ascending, BeforeValidator(listed)] = (
        1.0,
    )
    cases_per_file: PositiveInteger = 50

    @property
    def levels(self) -> tuple[float, ...]:
        """Forces or depths [SI]; one of 0 where nothing presses."""
        given = self.forces or self.depths
        return (0.0,) if given is None else given.all

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.places is None and (self.forces, self.depths, self.contact) != (None, None, None):
            raise wrong_value("missing: say where it presses", key="places")
        if self.places is not None and (self.forces is None) == (self.depths is None):
            raise wrong_value("give either forces or depths")
        if self.places is None and not self.cables and not self.chambers:
            raise wrong_value("missing, and nothing is driven: say what is varied", key="places")
        return self


def load_plan(path: Path) -> SweepPlan:
    """The plan in a TOML file.

    Raises ConfigError, one line for each mistake with the file and the key's path.
    """
    return validated(file_text(path), path, SweepPlan)


def check_count(plan: SweepPlan, cases: int) -> None:
    """Raise ConfigError for more cases than a plan may have."""
    if cases > MOST_CASES:
        raise ConfigError(f"{plan.path}: these are {cases} cases: plan at most {MOST_CASES}")


def _sets_apart(every: Sequence[Middle], apart: float, plan: SweepPlan) -> list[tuple[Middle, ...]]:
    if max(math.comb(len(every), c) for c in plan.contacts) > MOST_CASES:
        raise ConfigError(
            f"{plan.path}: places: {plan.contacts[-1]} contacts on {len(every)} places are too many sets: "
            'give fewer, or type = "random"'
        )
    sets: list[tuple[Middle, ...]] = []
    for c in plan.contacts:
        found = [each for each in combinations(every, c) if _are_apart(each, apart)]
        if not found:
            raise ConfigError(f"{plan.path}: places: no {c} of them are {1e3 * apart:g} mm apart")
        sets += found
    return sets


def _ranges(
    places: GridPlaces | RandomPlaces, plan: SweepPlan, within: WorkspaceSettings
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Of x and of y; within the workspace."""
    ranges = []
    for axis in ("x", "y"):
        allowed, given = getattr(within, axis), getattr(places, axis)
        if given is not None and (given[0] < allowed[0] or given[1] > allowed[1]):
            raise ConfigError(
                f"{plan.path}: places.{axis}: beyond contact.workspace, {_millimetres(allowed)}"
            )
        ranges.append(allowed if given is None else given)
    return ranges[0], ranges[1]


def _are_apart(places: tuple[Middle, ...], least: float) -> bool:
    # Neighbours of a grid are often as far apart as is asked, but for rounding.
    return all(math.dist(a, b) >= least * (1 - 1e-9) for a, b in combinations(places, 2))


def _spread(ends: tuple[float, float], count: int) -> list[float]:
    return [0.5 * (ends[0] + ends[1])] if count == 1 else np.linspace(*ends, count).tolist()


def _millimetres(span: tuple[float, float]) -> str:
    return f"{1e3 * span[0]:g} to {1e3 * span[1]:g} mm"
