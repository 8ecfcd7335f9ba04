"""What a sweep varies, as a TOML file: places, forces, numbers of contacts, cables, factors of all moduli.

Every combination is a case. Forces are swept from the lowest up at each place, so that each equilibrium is
searched from the one before.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Annotated, Generic, Literal, Self, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Le
from pydantic import BeforeValidator, Field, model_validator

from softfuse.errors import ConfigError
from softfuse.io.quantity import (
    Force,
    Integer,
    Length,
    PositiveInteger,
    PositiveNumber,
    wrong_value,
)
from softfuse.io.settings import Ascending, FileSettings, NotEmpty, Range, Settings, listed
from softfuse.robot.contacts import WorkspaceSettings
from softfuse.robot.file import file_text, validated
from softfuse.robot.settings import RobotSettings

Quantity = TypeVar("Quantity", bound=float)

MOST_CONTACTS = 4
MOST_CASES = 1_000_000
_TRIES = 10_000
"""Draws of random places for a case, until they are far enough apart."""

Disc = tuple[float, float]
"""x and y [m] of its middle."""


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


class DiscPlaces(Settings):
    """Middles of discs; those of a case are at least `apart` m from each other, None: two radii."""

    apart: Annotated[Length, Gt(0)] | None = None

    def sets(self, plan: "SweepPlan", config: RobotSettings) -> list[tuple[Disc, ...]]:
        """The places [m] of each case of a plan. Raises ConfigError when they do not suit the robot."""
        contact = config.contact()
        if contact.within is None:
            raise ConfigError(
                f'{plan.path}: places.type: this robot is pressed at its electrodes: give "electrodes"'
            )
        apart = 2 * contact.radius if self.apart is None else self.apart
        return self.within(contact.within, apart, plan)

    @abstractmethod
    def within(self, workspace: WorkspaceSettings, apart: float, plan: "SweepPlan") -> list[tuple[Disc, ...]]:
        """Those in a workspace, so far apart [m]."""


class GridPlaces(DiscPlaces):
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


class RandomPlaces(DiscPlaces):
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
        check_count(plan, len(plan.contacts) * self.count * len(plan.forces.all))
        x, y = _ranges(self, plan, workspace)
        low, size = np.array([x[0], y[0]]), np.array([x[1] - x[0], y[1] - y[0]])
        sets = list[tuple[Disc, ...]]()
        for contacts in plan.contacts:
            generator = np.random.Generator(np.random.PCG64([self.seed, contacts]))

            def draw(random=generator, shape=(contacts, 2)) -> tuple[Disc, ...]:
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


class ListedPlaces(DiscPlaces):
    """Places (p, 2) m; of several contacts, all sets of as many that are far enough apart."""

    type: Literal["list"]
    at: Annotated[tuple[tuple[Length, Length], ...], NotEmpty]

    def within(self, workspace, apart, plan):
        """As listed."""
        for k, place in enumerate(self.at):
            key = f"{plan.path}: places.at[{k}]"
            for value, axis in zip(place, "xy", strict=True):
                low, high = allowed = getattr(workspace, axis)
                if not low <= value <= high:
                    raise ConfigError(f"{key}: {axis} is beyond contact.workspace, {_millimetres(allowed)}")
            if place in self.at[:k]:
                raise ConfigError(f"{key}: this place is given twice")
        return _sets_apart(self.at, apart, plan)


class ElectrodePlaces(Settings):
    """Electrodes that are pressed, None: each; of several contacts, all sets of as many different ones."""

    type: Literal["electrodes"]
    names: Annotated[tuple[str, ...], NotEmpty] | None = None

    def sets(self, plan: "SweepPlan", config: RobotSettings) -> list[tuple[str, ...]]:
        """The electrodes of each case of a plan. Raises ConfigError when they do not suit the robot."""
        if config.contact().within is not None:
            raise ConfigError(
                f'{plan.path}: places.type: this is pressed in a workspace: give "grid", "random" or "list"'
            )
        known = list(config.places)
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


AnyPlaces = Annotated[GridPlaces | RandomPlaces | ListedPlaces | ElectrodePlaces, Field(discriminator="type")]


class CableLevels(Settings):
    """By how much (m) a cable is shortened, or with which tension (N) it is pulled."""

    name: str
    shortening: Lengths | None = None
    tension: Forces | None = None

    @property
    def all(self) -> tuple[float, ...]:
        """All shortenings or tensions (m,)."""
        levels = self.shortening or self.tension
        assert levels is not None
        return levels.all

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.shortening is None) == (self.tension is None):
            raise wrong_value("give either shortening or tension")
        return self


class SweepPlan(FileSettings):
    """A validated plan, in SI.

    forces: of each contact; contacts: how many at once; cables that are not named hang slack;
    modulus_factors: of all moduli of all materials; cases_per_file: about as many are solved in one go.
    """

    places: AnyPlaces
    forces: Forces
    contacts: Annotated[
        tuple[Annotated[Integer, Ge(1), Le(MOST_CONTACTS)], ...],
        NotEmpty,
        Ascending,
        BeforeValidator(listed),
    ] = (1,)
    cables: tuple[CableLevels, ...] = Field(default=(), alias="cable")
    modulus_factors: Annotated[tuple[PositiveNumber, ...], NotEmpty, Ascending, BeforeValidator(listed)] = (
        1.0,
    )
    cases_per_file: PositiveInteger = 50


def load_plan(path: Path) -> SweepPlan:
    """The plan in a TOML file.

    Raises ConfigError, one line for each mistake with the file and the key's path.
    """
    return validated(file_text(path), path, SweepPlan)


def check_count(plan: SweepPlan, cases: int) -> None:
    """Raise ConfigError for more cases than a plan may have."""
    if cases > MOST_CASES:
        raise ConfigError(f"{plan.path}: these are {cases} cases: plan at most {MOST_CASES}")


def _sets_apart(every: Sequence[Disc], apart: float, plan: SweepPlan) -> list[tuple[Disc, ...]]:
    if max(math.comb(len(every), c) for c in plan.contacts) > MOST_CASES:
        raise ConfigError(
            f"{plan.path}: places: {plan.contacts[-1]} contacts on {len(every)} places are too many sets: "
            'give fewer, or type = "random"'
        )
    sets: list[tuple[Disc, ...]] = []
    for c in plan.contacts:
        found = [each for each in combinations(every, c) if _are_apart(each, apart)]
        if not found:
            raise ConfigError(f"{plan.path}: places: no {c} of them are {1e3 * apart:g} mm apart")
        sets += found
    return sets


def _ranges(
    places: GridPlaces | RandomPlaces, plan: SweepPlan, within: WorkspaceSettings
) -> tuple[Disc, Disc]:
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


def _are_apart(places: tuple[Disc, ...], least: float) -> bool:
    # Neighbours of a grid are often as far apart as is asked, but for rounding.
    return all(math.dist(a, b) >= least * (1 - 1e-9) for a, b in combinations(places, 2))


def _spread(ends: Disc, count: int) -> list[float]:
    return [0.5 * (ends[0] + ends[1])] if count == 1 else np.linspace(*ends, count).tolist()


def _millimetres(span: Disc) -> str:
    return f"{1e3 * span[0]:g} to {1e3 * span[1]:g} mm"
