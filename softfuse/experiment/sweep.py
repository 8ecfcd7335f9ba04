"""Many cases of one robot in chunks of series, see `sweep_cases`.

A worker solves a chunk, and builds the robot once; client and worker exchange plain data only: the config as
text, numbers, names. What is told of each case, column by column, is in mm, N, mm³ and Pa.
"""

import json
import logging
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Literal

import jax.numpy as jnp
import numpy as np

from softfuse.errors import SoftfuseError
from softfuse.experiment.sweep_cases import Outcome, outcomes
from softfuse.io.result_folder import claim, put_in_place, writing
from softfuse.mechanics.model import Model
from softfuse.robot.digest import digest
from softfuse.robot.file import parse
from softfuse.robot.names import numbered, safe_names
from softfuse.robot.press_plan import SweepPlan
from softfuse.robot.press_series import (
    Driven,
    Series,
    build_series,
    driven_of,
    places_of,
    swept_model,
    with_moduli,
)
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.settings import RobotSettings

if TYPE_CHECKING:
    import pyarrow as pa

Value = float | int | str | None
"""None: not known, or not of this case."""

_ANSWERS: dict[Driven, Driven] = {"shortening": "tension", "tension": "shortening"}
"""What answers what a cable is driven by."""

_UNITS: dict[Driven, tuple[str, float]] = {
    "shortening": ("mm", 1e3),
    "tension": ("N", 1.0),
    "pressure": ("Pa", 1.0),
}
"""The unit that people read, and how many of it are one in SI."""

_building = Lock()
"""A worker may have several threads; they share one device."""

log = logging.getLogger(__name__)

_NAME = "sweep.json"

_MARK = b"softfuse.sweep"


@dataclass(frozen=True)
class SweepColumn:
    """One column: its name, which ends with the unit, what it holds and what that is in words."""

    name: str
    kind: Literal["integer", "number", "text"]
    about: str


class SweepTable:
    """The rows of a sweep of a robot."""

    def __init__(self, config: RobotSettings, swept: "Swept"):
        """Its columns."""
        self._swept = swept
        safe = safe_names(each.name for each in (*config.cables, *config.chambers))
        self._given = self._actuated(safe, given=True)
        self._readings = [*self._actuated(safe, given=False), *_enclosed(config, safe)]
        called = safe_names(each.name for each in config.contacts)
        contact = called[config.contact(swept.contact).name] if swept.contacts else ""
        self._names = numbered(contact, swept.contacts)
        self._axes = swept.axes
        self.columns: tuple[SweepColumn, ...] = (
            SweepColumn("case", "integer", "number of the case, from 0"),
            SweepColumn("modulus_factor", "number", "factor of all moduli"),
            *(column for column, _ in self._given),
            SweepColumn("contacts", "integer", "contacts at once"),
            *(column for name in self._names for column in self._contact(name)),
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
        given, answers = [series.levels[k]] * len(series.places), outcome.answer.tolist()
        forces, depths = (answers, given) if self._swept.by_depth else (given, answers)
        each: list[Value] = []
        for place, force, depth in zip(series.places, forces, depths, strict=True):
            each += [place] if isinstance(place, str) else [1e3 * x for x in place]
            each += [_known(force), _known(1e3 * depth)]
        each += [None] * (sum(len(self._contact(name)) for name in self._names) - len(each))
        actuated = zip(self._given, series.driven, strict=True)
        readings = zip(self._readings, outcome.reading, strict=True)
        return [
            series.number + k,
            series.modulus_factor,
            *(scale * drive for (_, scale), drive in actuated),
            len(series.places),
            *each,
            _known(sum(forces)),
            *(_known(scale * float(value)) for (_, scale), value in readings),
            _known(1e3 * outcome.largest_displacement),
            outcome.result,
            outcome.load_steps,
            outcome.newton_iterations,
            _known(outcome.residual),
            wall_time,
        ]

    def _contact(self, name: str) -> list[SweepColumn]:
        place = [SweepColumn(f"{name}_{axis}_mm", "number", "its middle") for axis in self._axes]
        return [
            *(place or [SweepColumn(f"{name}_place", "text", "the electrode that is pressed")]),
            SweepColumn(f"{name}_force_N", "number", "its total force"),
            SweepColumn(f"{name}_depth_mm", "number", "how far it has sunk in"),
        ]

    def _actuated(self, safe: Mapping[str, str], *, given: bool) -> list[tuple[SweepColumn, float]]:
        """Of each actuator what is given, or of each cable what answers that, by safe names, and how many of
        its unit are one in SI.
        """
        columns = []
        for name, what in self._swept.driven:
            if what == "pressure" and not given:
                continue
            shown = what if given else _ANSWERS[what]
            unit, scale = _UNITS[shown]
            about = f'{"given " if given else ""}{shown} of "{name}"'
            columns.append((SweepColumn(f"{safe[name]}_{unit}", "number", about), scale))
        return columns


def _enclosed(config: RobotSettings, safe: Mapping[str, str]) -> list[tuple[SweepColumn, float]]:
    """Of each chamber the change of its volume, then of each that is sealed the pressure in it; by safe
    names.
    """
    volumes = [
        (SweepColumn(f"{safe[each.name]}_mm3", "number", f'volume change of "{each.name}"'), 1e9)
        for each in config.chambers
    ]
    pressures = [
        (SweepColumn(f"{safe[each.name]}_Pa", "number", f'gauge pressure in "{each.name}"'), 1.0)
        for each in config.chambers
        if each.gas == "sealed"
    ]
    return [*volumes, *pressures]


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Swept:
    """What is swept of which robot, the same in all chunks.

    text, path, digest: of its config, the path absolute; contacts: the most at once, of the named one, None:
    the only one; axes: what tells its middle, none where electrodes do; by_depth: whether they are driven by
    their depth; driven: what is prescribed of each actuator, see `driven_of`.
    """

    text: str
    path: str
    digest: str
    contacts: int
    contact: str | None = None
    axes: str = ""
    by_depth: bool = False
    driven: tuple[tuple[str, Driven], ...] = ()

    def table(self, config: RobotSettings) -> SweepTable:
        """What is told of each case."""
        return SweepTable(config, self)


@dataclass(frozen=True)
class Chunk:
    """Some series of a sweep, whose rows make one file; number: from 0."""

    number: int
    swept: Swept
    series: tuple[Series, ...]

    @property
    def cases(self) -> int:
        """Number of cases."""
        return sum(len(each.levels) for each in self.series)

    @property
    def title(self) -> str:
        """By its first case."""
        return f"case {self.series[0].number}"


def chunks_of(text: str, config: RobotSettings, plan: SweepPlan) -> list[Chunk]:
    """The series of a plan in their order, together until there are `cases_per_file`; text: of the config.

    Raises ConfigError when the plan does not suit the robot.
    """
    series = build_series(plan, config)
    first = next((place for each in series for place in each.places), "")
    swept = Swept(
        text,
        str(config.path.resolve()),
        digest(config),
        0 if plan.places is None else plan.contacts[-1],
        plan.contact,
        "" if isinstance(first, str) else "xyz"[: len(first)],
        plan.depths is not None,
        tuple(driven_of(plan, config).items()),
    )
    groups: list[list[Series]] = []
    room = 0
    for each in series:
        if room <= 0:
            groups.append([])
            room = plan.cases_per_file
        groups[-1].append(each)
        room -= len(each.levels)
    return [Chunk(number, swept, tuple(group)) for number, group in enumerate(groups)]


def solve_chunk(chunk: Chunk) -> list[list[Value]]:
    """The rows of a chunk, in the columns of its `SweepTable`.

    Raises SoftfuseError when this worker has other files than the client, or the robot cannot be built.
    """
    with _building:
        robot, model = _built(chunk.swept)
    config, swept = robot.settings, chunk.swept
    table, drives = swept.table(config), [robot.addresses.drives[name] for name, _ in swept.driven]
    surface = np.asarray(robot.model.body.rest), np.asarray(robot.parts.faces)
    rows = []
    for series in chunk.series:
        stiff = with_moduli(model, config, series.modulus_factor)
        places = jnp.asarray(places_of(config, series, swept.contact, surface))
        begin = time.perf_counter()
        for k, outcome in enumerate(outcomes(stiff, series, places, drives)):
            end = time.perf_counter()
            rows.append(table.row(series, k, outcome, end - begin))
            begin = end
    return rows


@lru_cache(maxsize=1)
def _built(swept: Swept) -> tuple[Robot, Model]:
    config = parse(swept.text, Path(swept.path))
    if digest(config) != swept.digest:
        raise SoftfuseError(f"{swept.path}: a worker finds other files than here: share the folder")
    robot = build_robot(config)
    return robot, swept_model(robot, dict(swept.driven), swept.contact, by_depth=swept.by_depth)


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
