"""Many presses of one robot in chunks of series: equilibria at one place, each searched from the one before.

A worker solves a chunk, and builds the robot once; client and worker exchange plain data only: the config as
text, numbers, names. What is told of each case, column by column, is in mm, N, mm³ and Pa.
"""

import json
import logging
import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.errors import SoftfuseError
from softfuse.io.result_folder import claim, put_in_place, writing
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import State, result_name
from softfuse.robot.digest import digest
from softfuse.robot.file import parse
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
from softfuse.robot.settings import RobotSettings

if TYPE_CHECKING:
    import pyarrow as pa

OVERHANGS = "overhangs"
"""The result of a case in which a disc does not stand on the body with all of its face: nothing is solved."""

Value = float | int | str | None
"""None: not known, or not of this case."""

_building = Lock()
"""A worker may have several threads; they share one device."""

log = logging.getLogger(__name__)

_NAME = "sweep.json"

_MARK = b"softfuse.sweep"


@dataclass(frozen=True, eq=False)
class Outcome:
    """How one case ended, in SI: a name of `RESULTS` or `OVERHANGS`, and what the search took.

    reading (k,): of the robot; largest_displacement: of a node; NaN unless converged, and so is residual of
    what was not solved.
    """

    result: str
    newton_iterations: int
    load_steps: int
    residual: float
    reading: Float[np.ndarray, " k"]
    largest_displacement: float


def drives_of(model: Model, series: Series, rest: Float[np.ndarray, " D"]) -> Float[np.ndarray, "m D"]:
    """The drives (m, D) of the cases of a series: forces, then cables, then what the body at rest has.

    The cables come first among what is attached to the robot.
    """
    shares = np.tile(model.contacts[0].shares, len(series.places))
    pressed = len(shares)
    driven = pressed + len(series.cables)
    drives = np.tile(rest, (len(series.forces), 1))
    drives[:, :pressed] = np.array(series.forces)[:, None] * shares
    drives[:, pressed:driven] = series.cables
    return drives


def outcomes(model: Model, series: Series, places: Float[Array, "c 3 3"]) -> Iterator[Outcome]:
    """How the cases of a series at places (c, 3, 3) end on a robot of these moduli and cables, one by one.

    Each is searched from the last one that was found, the first from rest.
    """
    if not _stands(model, places):
        nothing = np.full(model.n_readings, np.nan)
        yield from (Outcome(OVERHANGS, 0, 0, np.nan, nothing, np.nan) for _ in series.forces)
        return
    at = _rest(model, places)
    for drive in drives_of(model, series, np.asarray(at.drive)):
        solution = simulate(model, places, jnp.asarray(drive), at)
        reading, largest = _measured(model, places, solution.state)
        name = result_name(solution.result)
        found = solution.success
        at = solution.state if found else at
        yield Outcome(
            name,
            int(solution.stats.newton_iterations),
            int(solution.stats.load_steps),
            float(solution.stats.residual),
            np.asarray(reading) if found else np.full(model.n_readings, np.nan),
            float(largest) if found else np.nan,
        )


@eqx.filter_jit
def _stands(model: Model, places: Float[Array, "c 3 3"]) -> Bool[Array, ""]:
    each = zip(model.kinds(len(places)), places, strict=True)
    return jnp.all(jnp.stack([kind.stands(model.body, place) for kind, place in each]))


@eqx.filter_jit
def _rest(model: Model, places: Array) -> State:
    return model.rest_state(places)


@eqx.filter_jit
def _measured(model: Model, places: Array, state: State) -> tuple[Float[Array, " k"], Float[Array, ""]]:
    moved = jnp.linalg.norm(model.body.displacement(state.z), axis=1)
    return model.reading(state, places), jnp.max(moved)


@dataclass(frozen=True)
class SweepColumn:
    """One column: its name, which ends with the unit, what it holds and what that is in words."""

    name: str
    kind: Literal["integer", "number", "text"]
    about: str


class SweepTable:
    """The rows of the sweep of a robot, with up to so many contacts at once."""

    def __init__(self, config: RobotSettings, contacts: int, shortened: tuple[bool, ...]):
        """shortened: of each cable, whether its shortening is given; its tension is otherwise."""
        self._contacts, self._shortened = contacts, shortened
        self._discs = config.contact().within is not None
        self._readings = [*self._cables(config, given=False), *_volumes(config), *_pressures(config)]
        self.columns: tuple[SweepColumn, ...] = (
            SweepColumn("case", "integer", "number of the case, from 0"),
            SweepColumn("modulus_factor", "number", "factor of all moduli"),
            *(column for column, _ in self._cables(config, given=True)),
            SweepColumn("contacts", "integer", "contacts at once"),
            *(column for k in range(contacts) for column in self._contact(k)),
            SweepColumn("force_N", "number", "sum of the forces"),
            *(column for column, _ in self._readings),
            SweepColumn("largest_displacement_mm", "number", "of a node"),
            SweepColumn("result", "text", "how the search ended"),
            SweepColumn("load_steps", "integer", "accepted ones, from the case before at the same place"),
            SweepColumn("newton_iterations", "integer", "from the case before at the same place"),
            SweepColumn("residual_N", "number", "largest unbalanced force on a node"),
            SweepColumn("wall_time_s", "number", "with compiling, where that was needed"),
        )

    def row(self, series: Series, k: int, outcome: Outcome, wall_time: float) -> list[Value]:
        """The values of the columns for case number k of a series; wall_time [s]."""
        force = series.forces[k]
        given = zip(self._shortened, series.cables, strict=True)
        each: list[Value] = []
        for place in series.places:
            each += [place] if isinstance(place, str) else [1e3 * x for x in place]
            each.append(force)
        width = len(self._contact(0))
        each += [None] * (width * (self._contacts - len(series.places)))
        readings = zip(self._readings, outcome.reading, strict=True)
        return [
            series.number + k,
            series.modulus_factor,
            *(1e3 * drive if by_length else drive for by_length, drive in given),
            len(series.places),
            *each,
            force * len(series.places),
            *(_known(scale * float(value)) for (_, scale), value in readings),
            _known(1e3 * outcome.largest_displacement),
            outcome.result,
            outcome.load_steps,
            outcome.newton_iterations,
            _known(outcome.residual),
            wall_time,
        ]

    def _contact(self, k: int) -> list[SweepColumn]:
        place = (
            [SweepColumn(f"contact{k}_{axis}_mm", "number", "middle of the disc") for axis in "xy"]
            if self._discs
            else [SweepColumn(f"contact{k}_electrode", "text", "the electrode that is pressed")]
        )
        return [*place, SweepColumn(f"contact{k}_force_N", "number", "its total force")]

    def _cables(self, config: RobotSettings, *, given: bool) -> list[tuple[SweepColumn, float]]:
        """Of each cable what is given, or what answers that, and how many of its unit are one in SI."""
        columns = []
        for k, (cable, shortened) in enumerate(zip(config.cables, self._shortened, strict=True)):
            unit, what, scale = ("mm", "shortening", 1e3) if shortened == given else ("N", "tension", 1.0)
            about = f'{"given " if given else ""}{what} of "{cable.name}"'
            columns.append((SweepColumn(f"cable{k}_{unit}", "number", about), scale))
        return columns


def _volumes(config: RobotSettings) -> list[tuple[SweepColumn, float]]:
    return [
        (SweepColumn(f"dV{k}_mm3", "number", f'volume change of "{chamber.name}"'), 1e9)
        for k, chamber in enumerate(config.chambers)
    ]


def _pressures(config: RobotSettings) -> list[tuple[SweepColumn, float]]:
    return [
        (SweepColumn(f"pressure{k}_Pa", "number", f'gauge pressure in "{chamber.name}"'), 1.0)
        for k, chamber in enumerate(config.chambers)
        if chamber.gas == "sealed"
    ]


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Pressed:
    """Which robot is pressed, the same in all chunks of a sweep.

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
    """The series of a plan in their order, together until there are `cases_per_file`; text: of the config.

    Raises ConfigError when the plan does not suit the robot.
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

    Raises SoftfuseError when this worker has other files than the client, or the robot cannot be built.
    """
    with _building:
        config, model = _model(chunk.pressed)
    table = chunk.pressed.table(config)
    rows = []
    for series in chunk.series:
        pressed = with_moduli(model, config, series.modulus_factor)
        begin = time.perf_counter()
        for k, outcome in enumerate(outcomes(pressed, series, jnp.asarray(places_of(config, series)))):
            end = time.perf_counter()
            rows.append(table.row(series, k, outcome, end - begin))
            begin = end
    return rows


@lru_cache(maxsize=1)
def _model(pressed: Pressed) -> tuple[RobotSettings, Model]:
    config = parse(pressed.text, Path(pressed.path))
    if digest(config) != pressed.digest:
        raise SoftfuseError(f"{pressed.path}: a worker finds other files than here: share the folder")
    return config, swept_model(build_robot(config), pressed.shortened)


class SweepFolder:
    """The files of one sweep: which it is, and a Parquet file for each chunk that is finished."""

    def __init__(self, path: Path, identity: Mapping[str, str], columns: Sequence[SweepColumn]):
        """Make the folder, or find the sweep in it; raises SoftfuseError when there is another one in it."""
        self._path, self._columns = path, columns
        about = {"columns": {column.name: column.about for column in columns}}
        self._identity = claim(path, _NAME, "a sweep", identity, about=about, parts="part-*.parquet")

    def has(self, number: int, cases: int) -> bool:
        """Whether the file of a chunk of so many cases is there and whole."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        part = self._part(number)
        try:
            metadata = pq.read_metadata(part)
        except FileNotFoundError:
            return False
        except (OSError, pa.ArrowException) as error:
            log.warning("%s cannot be read and is made anew: %s", part, str(error).partition("\n")[0])
            return False
        own = self._schema().metadata[_MARK]
        if metadata.num_rows == cases and (metadata.metadata or {}).get(_MARK) == own:
            return True
        log.warning("%s is of another sweep or not whole and is made anew", part)
        return False

    def write(self, number: int, rows: Sequence[Sequence[Value]]) -> None:
        """Write the rows of a chunk; its file appears when it is whole. SoftfuseError when it cannot be."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        schema = self._schema()
        columns = zip(schema, zip(*rows, strict=True), strict=True)
        table = pa.Table.from_arrays(
            [pa.array(values, field.type) for field, values in columns], schema=schema
        )
        with writing(self._path), put_in_place(self._part(number)) as part:
            pq.write_table(table, part, compression="zstd", write_page_checksum=True)

    def results(self, chunks: int) -> Counter[str]:
        """How often the cases of so many chunks ended in which way."""
        import pyarrow.dataset as ds

        files = [str(self._part(number)) for number in range(chunks)]
        found = ds.dataset(files, schema=self._schema()).to_table(columns=["result"])
        return Counter(found.column("result").to_pylist())

    def _schema(self) -> "pa.Schema":
        import pyarrow as pa

        types = {"integer": pa.int64(), "number": pa.float64(), "text": pa.string()}
        fields = [
            pa.field(column.name, types[column.kind], metadata={"about": column.about})
            for column in self._columns
        ]
        return pa.schema(fields, metadata={_MARK: json.dumps(self._identity)})

    def _part(self, number: int) -> Path:
        return self._path / f"part-{number:05d}.parquet"
