"""What a sweep varies, as a TOML file: places, forces, numbers of contacts, cables, factors of all moduli.

Every combination is a case. Forces are swept from the lowest up at each place, so that each equilibrium is
searched from the one before.
"""

from pathlib import Path
from typing import Annotated, Generic, Literal, Self, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Le
from pydantic import BeforeValidator, Field, model_validator

from softfuse.io.quantity import (
    Force,
    Integer,
    Length,
    PositiveInteger,
    PositiveNumber,
    wrong_value,
)
from softfuse.io.settings import Ascending, FileSettings, NotEmpty, Range, Settings, listed
from softfuse.robot.file import file_text, validated

Quantity = TypeVar("Quantity", bound=float)

MOST_CONTACTS = 4


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


class GridPlaces(DiscPlaces):
    """count places along x and along y over ranges in m, their ends included; None: those of the workspace.

    Of several contacts, all sets of as many places that are far enough apart.
    """

    type: Literal["grid"]
    count: tuple[PositiveInteger, PositiveInteger]
    x: Range | None = None
    y: Range | None = None


class RandomPlaces(DiscPlaces):
    """count sets of as many places as there are contacts, each place evenly distributed over the ranges in m.

    The same seed gives the same places.
    """

    type: Literal["random"]
    count: PositiveInteger
    seed: Annotated[Integer, Ge(0)] = 0
    x: Range | None = None
    y: Range | None = None


class ListedPlaces(DiscPlaces):
    """Places (p, 2) m; of several contacts, all sets of as many that are far enough apart."""

    type: Literal["list"]
    at: Annotated[tuple[tuple[Length, Length], ...], NotEmpty]


class ElectrodePlaces(Settings):
    """Electrodes that are pressed, None: each; of several contacts, all sets of as many different ones."""

    type: Literal["electrodes"]
    names: Annotated[tuple[str, ...], NotEmpty] | None = None


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
