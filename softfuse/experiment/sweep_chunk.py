"""A sweep in chunks, each of which is solved by a worker, which builds the device once.

Client and worker exchange plain data only: the config as text, numbers, names.
"""

import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock

import jax.numpy as jnp

from softfuse.errors import SoftfuseError
from softfuse.experiment.sweep import outcomes
from softfuse.experiment.sweep_table import SweepTable, Value
from softfuse.mechanics.model import Model
from softfuse.robot.digest import digest
from softfuse.robot.file import RobotSettings, parse
from softfuse.robot.press_plan import SweepPlan
from softfuse.robot.press_series import (
    Series,
    build_series,
    places_of,
    shortened_cables,
    swept_model,
    with_moduli,
)
from softfuse.robot.robot import build_robot


@dataclass(frozen=True)
class Pressed:
    """Which device is pressed, the same in all chunks of a sweep.

    text, path, digest: of its config, the path absolute; contacts: the most at once; shortened: of each
    cable, whether it is shortened or pulled.
    """

    text: str
    path: str
    digest: str
    contacts: int
    shortened: tuple[bool, ...]

    def table(self, config: RobotSettings) -> SweepTable:
        """What is told of each case."""
        return SweepTable(config, self.contacts, self.shortened)


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


def chunks_of(text: str, config: RobotSettings, plan: SweepPlan) -> list[Chunk]:
    """The series of a plan in their order, put together until there are `cases_per_file` cases or more; text:
    of the config.

    Raises ConfigError when the plan does not suit the device.
    """
    path, shortened = str(config.path.resolve()), shortened_cables(plan, config)
    pressed = Pressed(text, path, digest(config), plan.contacts[-1], shortened)
    groups: list[list[Series]] = []
    room = 0
    for each in build_series(plan, config):
        if room <= 0:
            groups.append([])
            room = plan.cases_per_file
        groups[-1].append(each)
        room -= len(each.forces)
    return [Chunk(number, pressed, tuple(group)) for number, group in enumerate(groups)]


def solve_chunk(chunk: Chunk) -> list[list[Value]]:
    """The rows of a chunk, in the columns of its `SweepTable`.

    Raises SoftfuseError when this worker has other files than the client, or the device cannot be built.
    """
    with _building:
        config, device = _device(chunk.pressed)
    table = chunk.pressed.table(config)
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
    config = parse(pressed.text, Path(pressed.path))
    if digest(config) != pressed.digest:
        raise SoftfuseError(f"{pressed.path}: a worker finds other files than here: share the folder")
    return config, swept_model(build_robot(config), pressed.shortened)
