"""Where to press: a grid over the workspace, a list, and which of these a recording holds already."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from softfuse.errors import RecordingError
from softfuse.hardware.table.form import FOUND
from softfuse.hardware.table.table import Table

Point = tuple[float, float]
"""x, y in the body's coordinates [m]."""

SAME_MM = 0.05
"""Places nearer to each other than this are one [mm]; a stage stops within 0.02 mm."""
LABELS = ("press", "sample", "true_x_mm", "true_y_mm", "true_force_N")
"""The columns that say what was done, as in a recording with truth."""


def grid(x: tuple[float, float], y: tuple[float, float], count: tuple[int, int]) -> list[Point]:
    """count (in x, in y) places over the ranges [m], their ends included, there and back along x."""
    along = [_spread(x, count[0]), _spread(y, count[1])]
    return [
        (a, b) for j, b in enumerate(along[1]) for a in (along[0] if j % 2 == 0 else list(reversed(along[0])))
    ]


def read_places(path: Path) -> list[Point]:
    """The places of a CSV file with the columns x_mm and y_mm; RecordingError where it is none."""
    asked = "give two numbers in the columns x_mm and y_mm"
    try:
        table = Table(path, ["x_mm", "y_mm"], FOUND, timed=False)
    except RecordingError as error:
        raise RecordingError(f"cannot read the places: {error}; {asked} from line 2 on") from error
    x, y = table.channels.index("x_mm"), table.channels.index("y_mm")
    places = list[Point]()
    for block in table.blocks():
        if block.malformed.any():
            raise RecordingError(f"{path}, line {block.line[block.malformed][0]}: {asked}")
        at = zip(1e-3 * block.values[x], 1e-3 * block.values[y], strict=True)
        places += [(float(a), float(b)) for a, b in at]
    if not places:
        raise RecordingError(f"{path} holds no places: give at least one, in the columns x_mm and y_mm")
    return places


def pressed(columns: Mapping[str, Float[np.ndarray, " n"]], levels: int) -> list[Point]:
    """The places [m] of which a recording with these columns holds a sample of each of so many levels."""
    found: dict[int, tuple[set[int], Point]] = {}
    for press, sample, x, y in _samples(columns):
        held, _ = found.setdefault(press, (set(), (1e-3 * x, 1e-3 * y)))
        held.add(sample)
    return [at for held, at in found.values() if held >= set(range(1, levels + 1))]


def next_press(columns: Mapping[str, Float[np.ndarray, " n"]]) -> int:
    """The first number that no press of a recording has."""
    numbers = columns["press"][np.isfinite(columns["press"])] if "press" in columns else np.zeros(0)
    return int(numbers.max()) + 1 if numbers.size else 0


def remaining(places: Sequence[Point], done: Iterable[Point]) -> list[Point]:
    """The places that are not done, in order."""
    done = list(done)
    return [at for at in places if all(1e3 * math.dist(at, other) > SAME_MM for other in done)]


def _samples(columns: Mapping[str, Float[np.ndarray, " n"]]) -> list[tuple[int, int, float, float]]:
    names = LABELS[:4]
    if not all(name in columns for name in names):
        return []
    table = np.stack([columns[name] for name in names], axis=1)
    table = table[np.isfinite(table).all(axis=1) & (columns["sample"] > 0)]
    return [(int(press), int(sample), x, y) for press, sample, x, y in table.tolist()]


def _spread(ends: tuple[float, float], count: int) -> list[float]:
    if count == 1:
        return [0.5 * (ends[0] + ends[1])]
    return np.linspace(*ends, count).tolist()
