"""What a worker of a sweep does: it builds the device once, and solves one chunk of cases after the other.

Client and worker exchange plain data only: the config as text, numbers, names.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock

import jax.numpy as jnp

from softfuse.cli.sweep_table import SweepTable, Value
from softfuse.cli.version import require_version
from softfuse.computing import prepare_jax
from softfuse.errors import SoftfuseError
from softfuse.experiment.sweep import outcomes
from softfuse.mechanics.model import Model
from softfuse.robot.digest import digest
from softfuse.robot.file import RobotSettings, parse
from softfuse.robot.press_series import Series, places_of, swept_model, with_moduli
from softfuse.robot.robot import build_robot


@dataclass(frozen=True)
class Pressed:
    """Which device is pressed, the same in all chunks of a sweep.

    text, path, digest: of its config, the path absolute; contacts: the most at once; shortened: of each
    cable, whether it is shortened or pulled; version: of softfuse.
    """

    text: str
    path: str
    digest: str
    contacts: int
    shortened: tuple[bool, ...]
    version: str


@dataclass(frozen=True)
class Chunk:
    """Some series of a sweep, whose rows make one file; number: from 0."""

    number: int
    pressed: Pressed
    series: tuple[Series, ...]

    @property
    def cases(self) -> int:
        """Number of cases."""
        return sum(len(each.forces) for each in self.series)

    @property
    def title(self) -> str:
        """By its first case."""
        return f"case {self.series[0].number}"


def chunks_of(pressed: Pressed, series: Sequence[Series], cases: int) -> list[Chunk]:
    """Series in their order, put together until there are so many cases or more."""
    groups: list[list[Series]] = []
    room = 0
    for each in series:
        if room <= 0:
            groups.append([])
            room = cases
        groups[-1].append(each)
        room -= len(each.forces)
    return [Chunk(number, pressed, tuple(group)) for number, group in enumerate(groups)]


def solve_chunk(chunk: Chunk) -> list[list[Value]]:
    """The rows of a chunk, in the columns of its `SweepTable`.

    Raises SoftfuseError when this worker has another softfuse or other files than the client, or the device
    cannot be built.
    """
    prepare_jax()
    with _building:
        config, device = _device(chunk.pressed)
    table = SweepTable(config, chunk.pressed.contacts, chunk.pressed.shortened)
    rows = []
    for series in chunk.series:
        pressed = with_moduli(device, config, series.modulus_factor)
        begin = time.perf_counter()
        for k, outcome in enumerate(outcomes(pressed, series, jnp.asarray(places_of(config, series)))):
            end = time.perf_counter()
            rows.append(table.row(series, k, outcome, end - begin))
            begin = end
    return rows


_building = Lock()
"""A worker may have several threads; they share one device."""


@lru_cache(maxsize=1)
def _device(pressed: Pressed) -> tuple[RobotSettings, Model]:
    require_version(pressed.version)
    config = parse(pressed.text, Path(pressed.path))
    if digest(config) != pressed.digest:
        raise SoftfuseError(f"{pressed.path}: a worker finds other files than here: share the folder")
    return config, swept_model(build_robot(config), pressed.shortened)
