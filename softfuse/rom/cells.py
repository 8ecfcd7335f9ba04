"""Where contacts may be, in regions with a chart of a reduced body for each: the cells of a workspace, or
electrodes.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.functional.chart import FlatChart, facing
from softfuse.functional.contact import Contact

_MARGIN = 0.05
"""Of a cell: how far a place may leave it before another one is looked for."""

_SIDE = 21
"""Places along each edge of a cell. They find faces whose edge crosses what a point of the disc passes over,
and those that hold one of its corners."""

_INSIDE = 1e-3
"""So far inside a face, as a part of the way to its middle, its corners are tried."""


_BEYOND = 1.15
"""Parts of a cell are enlarged by so much, so that they overlap."""

Part = Callable[[Float[np.ndarray, "... 2"]], Float[np.ndarray, "... 3 3"]]
"""Places (..., 3, 3) of a part of a region by coordinates (..., 2), ±1 at the edges."""


class Cell(NamedTuple):
    """Where a disc's middle may be, within `half` (2,) m of `centre` (2,) m in the `chart` of what is seen
    along the direction in which it presses.
    """

    centre: Float[np.ndarray, "2"]
    half: Float[np.ndarray, "2"]
    chart: FlatChart

    def at(self, coordinates: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 3 3"]:
        """Places (..., 3, 3) of coordinates (..., 2), ±1 at the edges."""
        return np.asarray(self.chart.place(jnp.asarray(self.centre + self.half * coordinates)))

    def grid(self, side: int) -> Float[np.ndarray, "s 3 3"]:
        """`side` x `side` places (s, 3, 3) evenly over the cell and a little around it, as far as a place may
        be that is still taken to be in it.
        """
        return self.at((1 + 2 * _MARGIN) * pairs(np.linspace(-1, 1, side)))

    def parts(self, side: int) -> list[Part]:
        """`side` x `side` equal parts."""
        return [
            lambda spread, middle=middle: self.at(middle + _BEYOND / side * spread)
            for middle in pairs((2 * np.arange(side) + 1) / side - 1)
        ]

    def holds(self, places: Float[np.ndarray, "... 3 3"]) -> Bool[np.ndarray, "..."]:
        """Which places (..., 3, 3) may be taken to be in it."""
        away = np.abs(self.chart.coordinates(places) - self.centre)
        return np.all(away <= (1 + 2 * _MARGIN) * self.half, axis=-1)


class AbstractRegions(ABC):
    """Numbered regions of places."""

    @abstractmethod
    def __len__(self) -> int:
        """How many."""

    @abstractmethod
    def find(self, place: Array | np.ndarray, before: int | None = None) -> int | None:
        """The region of a place (3, 3), `before` while it is not clearly outside of that; None for none."""

    @abstractmethod
    def middle(self, number: int) -> Float[np.ndarray, "3 3"]:
        """The place (3, 3) in the middle of a region."""

    @abstractmethod
    def parts(self, number: int, side: int) -> list[Part]:
        """A region's parts, `side` x `side` of one that has edges."""

    @abstractmethod
    def around(
        self, number: int, discs: Iterable[Contact], rest: Float[np.ndarray, "k 3"]
    ) -> Float[np.ndarray, "s 3 3"]:
        """Places (s, 3, 3) in a region, so close to each other that what presses with some discs, on a
        surface of nodes at `rest` (k, 3) m, meets no face between them that it does not meet at them.
        """


@dataclass(frozen=True, eq=False)
class Spots(AbstractRegions):
    """Places (e, 3, 3), such as the middles of electrodes, each with what is nearest to it as its region."""

    places: Float[np.ndarray, "e 3 3"]

    def __len__(self) -> int:
        return len(self.places)

    def find(self, place, before=None):
        """The nearest."""
        del before
        return int(np.argmin(np.sum((self.places[:, 0] - np.asarray(place)[0]) ** 2, axis=1)))

    def middle(self, number):
        """The place."""
        return self.places[number]

    def parts(self, number, side):
        """The place, wherever one is in it."""
        del side
        place = self.places[number]
        return [lambda spread: np.broadcast_to(place, (*spread.shape[:-1], 3, 3))]

    def around(self, number, discs, rest):
        """The place."""
        del discs, rest
        return self.places[number][None]


@dataclass(frozen=True, eq=False)
class Cells(AbstractRegions):
    """A workspace from `low` to `high` (2,) [m] in a chart, in so many equal cells along its axes, numbered
    along the second first; what presses there does so along the chart's direction.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    counts: tuple[int, int]
    chart: FlatChart

    @classmethod
    def over(
        cls,
        low: tuple[float, float],
        high: tuple[float, float],
        edge: float,
        direction: tuple[float, float, float] = (0.0, 0.0, -1.0),
    ) -> "Cells":
        """Cells with no edge longer than so much [m]."""
        size = np.subtract(high, low)
        x, y = np.maximum(1, np.ceil(size / edge - 1e-9)).astype(int)
        return cls(low, high, (int(x), int(y)), FlatChart.along(direction))

    def __len__(self) -> int:
        return self.counts[0] * self.counts[1]

    def __getitem__(self, number: int) -> Cell:
        """A cell by its number; raises IndexError for one that there is not."""
        if not 0 <= number < len(self):
            raise IndexError(f"cell {number} of {len(self)}")
        half = np.subtract(self.high, self.low) / np.array(self.counts) / 2
        place = np.array(divmod(number, self.counts[1]))
        return Cell(self.low + half * (2 * place + 1), half, self.chart)

    @cached_property
    def _across(self) -> Float[np.ndarray, "3 2"]:
        return np.asarray(self.chart.axes).T

    def middle(self, number):
        """That of the cell."""
        return self[number].at(np.zeros(2))

    def parts(self, number, side):
        """Those of the cell."""
        return self[number].parts(side)

    def around(self, number, discs, rest):
        """A grid, and the edges of what each disc meets."""
        return np.concatenate([places_over(self[number], disc, rest) for disc in discs])

    def find(self, place, before=None):
        """The cell that a place (3, 3) is in."""
        # In plain numbers: this is asked in every frame.
        at = (np.asarray(place)[0] @ self._across).tolist()
        given = zip(at, self.low, self.high, self.counts, strict=True)
        inside = [(at - low) / (high - low) * count for at, low, high, count in given]
        if before is not None:
            corner = divmod(before, self.counts[1])
            if all(abs(at - k - 0.5) <= 0.5 + _MARGIN for at, k in zip(inside, corner, strict=True)):
                return before
        if not all(-_MARGIN <= at <= k + _MARGIN for at, k in zip(inside, self.counts, strict=True)):
            return None
        x, y = (min(max(int(at), 0), k - 1) for at, k in zip(inside, self.counts, strict=True))
        return x * self.counts[1] + y


def pairs(steps: Float[np.ndarray, " k"]) -> Float[np.ndarray, "kk 2"]:
    """All pairs (k k, 2) of some numbers (k,)."""
    return np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)


def places_over(cell: Cell, disc: Contact, rest: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "s 3 3"]:
    """Places (s, 3, 3) in a cell, for a disc on a surface of nodes at `rest` (k, 3) m.

    A grid; and where a point of the disc passes over a corner of a face, that comes in from there as narrow
    as may be, a place at which the point lies in this corner.
    """
    surface = disc.surface
    tangents, direction = np.asarray(surface.tangents), np.asarray(surface.direction)
    corners = rest[np.asarray(surface.faces)[:, :3]] @ tangents.T
    inside = corners + _INSIDE * (corners.mean(axis=1, keepdims=True) - corners)
    offsets = np.asarray(disc.points - disc.location) @ tangents.T
    places = (inside[:, :, None] - offsets) @ tangents
    places = facing(places.reshape(len(corners), -1, 3), direction)
    held = cell.holds(places)
    # One place is enough to know all nodes of a face.
    one = np.argmax(held, axis=1)
    return np.concatenate([cell.grid(_SIDE), places[np.arange(len(places)), one][held.any(axis=1)]])
