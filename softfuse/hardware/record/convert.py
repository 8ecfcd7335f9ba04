"""Sessions, CSV and Parquet into each other; which is which is told by the file's suffix.

A session is a .mcap file, a recording .csv or .csv.gz. What is converted are the frames (every number bit for
bit, missing stays missing) or the estimates of a session. A file appears under its name when it is whole.

The CSV is that of `softfuse.hardware.recording`: `time_s` and the channels, one row a frame. Every number has
the fewest digits that give back the same 64 bits; what is missing or not finite is an empty field. Parquet
has one column each, 64 bit floats, null where missing, compressed by zstd.
"""

import csv
import gzip
import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from io import StringIO
from itertools import count, islice
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, Kind, SessionInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.record.session_writer import SessionWriter
from softfuse.hardware.table.form import FOUND
from softfuse.hardware.table.table import TIME, Table
from softfuse.io.result_folder import put_in_place
from softfuse.robot.recording import RecordingSettings

if TYPE_CHECKING:
    import pyarrow as pa


logger = logging.getLogger(__name__)
INDEX = "index"
_CELLS = 1 << 20
"""Numbers that are held at a time."""
SUFFIXES = (".mcap", ".csv", ".csv.gz", ".parquet")
SESSION = ".mcap"


@dataclass(frozen=True)
class FrameTable:
    """Frames of n channels, to be gone through once."""

    source: Path
    """The file that they are read from."""
    channels: tuple[str, ...]
    frames: Iterator[FrameEntry]
    device: str = ""
    """The device's name, where it is known."""
    started: str = ""
    """When it was recorded, in ISO 8601, where it is known."""


def read_csv(path: Path, form: RecordingSettings = FOUND) -> FrameTable:
    """The frames of a recording, .csv or .csv.gz, numbered by row, of all columns but those that hold texts
    only; read as they are gone through.

    form: how the file is written, as far as it is told. Raises RecordingError as `read_recording`.
    """
    table = Table(path, [], form)
    kept = [c for c in range(len(table.channels)) if c not in table.worded]
    channels = tuple(table.channels[c] for c in kept)
    for c in sorted(table.worded):
        logger.warning("%s: %r holds texts, not numbers: left out", path, table.channels[c])

    def frames() -> Iterator[FrameEntry]:
        number, damaged = count(), list[int]()
        for block in table.blocks():
            damaged += block.line[block.malformed].tolist()
            values = np.array([block.values[c] for c in kept]).reshape(len(kept), -1).T
            for at, row in zip(block.time_s.tolist(), values, strict=True):
                yield FrameEntry(next(number), at, row)
        if damaged:
            logger.warning(
                "%s: %d rows cannot be read in full, first line %d", path, len(damaged), damaged[0]
            )

    return FrameTable(path, channels, frames())


def write_csv(path: Path, table: FrameTable, *, compressed: bool) -> int:
    """Write frames, and return how many.

    Raises: RecordingError for a channel whose name a header cannot hold; OSError as the disk does.
    """
    header = csv_header(table.channels)
    written = 0
    with _text(path, compressed) as stream:
        stream.write(header)
        for frame in table.frames:
            fields = (csv_field(value) for value in (float(frame.time_s), *frame.values.tolist()))
            stream.write(",".join(fields) + "\n")
            written += 1
    return written


def _estimate_columns(kinds: Mapping[str, Kind]) -> list[tuple[str, str, Callable[[EstimateEntry], Any]]]:
    """Name, what it holds, and how to find it, of all columns of a table of estimates."""
    return [
        (TIME, "number", attrgetter("time_s")),
        ("frame", "integer", attrgetter("frame")),
        ("sensed", "integer", attrgetter("sensed")),
        *((name, kind, lambda entry, name=name: entry.fields[name]) for name, kind in kinds.items()),
        ("latency_ms", "number", attrgetter("latency_ms")),
        ("end_to_end_ms", "number", attrgetter("end_to_end_ms")),
        ("status", "strings", attrgetter("status")),
    ]


def write_csv_estimates(
    path: Path, kinds: Mapping[str, Kind], estimates: Iterator[EstimateEntry], *, compressed: bool
) -> int:
    """Write estimates, one row each, and return how many; OSError as the disk does."""
    *columns, (status, _, statuses_of) = _estimate_columns(kinds)
    written = 0
    with _text(path, compressed) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*(name for name, _, _ in columns), status])
        for entry in estimates:
            fields = [csv_field(value_of(entry)) for _, _, value_of in columns]
            writer.writerow([*fields, "; ".join(statuses_of(entry))])
            written += 1
    return written


def csv_header(channels: tuple[str, ...]) -> str:
    """The first line, with its end; RecordingError for a channel whose name it cannot hold."""
    for name in channels:
        if not name or name != name.strip().lstrip("\ufeff") or any(sign in name for sign in ",\r\n"):
            raise RecordingError(f"the channel {name!r} cannot be named in a CSV file: rename it")
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerow([TIME, *channels])
    return text.getvalue()


def csv_field(value: float | str | None) -> str:
    """A number with the fewest digits that give it back, a text as it is; empty what is missing."""
    if isinstance(value, str):
        return value
    return repr(value) if value is not None and math.isfinite(value) else ""


@contextmanager
def _text(path: Path, compressed: bool) -> Iterator[TextIO]:
    if compressed:
        with gzip.open(path, "wt", encoding="utf-8", newline="") as stream:
            yield stream
    else:
        with path.open("w", encoding="utf-8", newline="") as stream:
            yield stream


def read_parquet(path: Path) -> FrameTable:
    """The frames of a table of numbers with a column `time_s`, numbered by its column `index` or by row.

    Raises: RecordingError when it is no Parquet file, lacks `time_s`, names a column twice, or a column holds
    something else than numbers; while going through the frames also when the file is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        schema = file.schema_arrow
    except (pa.ArrowException, OSError, UnicodeError) as error:
        raise RecordingError(f"cannot read {path} as a Parquet file: {_first_line(error)}") from error
    names = list(schema.names)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(f"{path} names the column {twice[0]!r} twice: rename or drop one")
    if TIME not in names:
        raise RecordingError(f"{path} lacks the column {TIME!r}; it has: {', '.join(map(repr, names[:20]))}")
    for column in schema:
        if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            raise RecordingError(
                f"the column {column.name!r} of {path} holds {column.type}, not numbers: drop it"
            )
    channels = tuple(name for name in names if name not in (TIME, INDEX))

    def frames() -> Iterator[FrameEntry]:
        row = 0
        try:
            for batch in file.iter_batches(batch_size=_rows(len(names))):
                columns = {name: _floats(batch.column(name)) for name in (TIME, *channels)}
                values = np.array([columns[name] for name in channels]).reshape(len(channels), -1).T
                numbers = batch.column(INDEX).to_pylist() if INDEX in names else range(row, row + len(batch))
                for index, at, one in zip(numbers, columns[TIME].tolist(), values, strict=True):
                    yield FrameEntry(_counted(index, path), at, one)
                row += len(batch)
        except (pa.ArrowException, OSError, UnicodeError) as error:
            raise RecordingError(f"cannot read {path} after row {row}: {_first_line(error)}") from error

    return FrameTable(path, channels, frames())


def write_parquet(path: Path, table: FrameTable) -> int:
    """Write frames, and return how many; OSError as the disk does."""
    import pyarrow as pa

    floats = [(name, pa.float64()) for name in (TIME, *table.channels)]
    schema = pa.schema([(INDEX, pa.int64()), *floats])

    def batch(frames: Sequence[FrameEntry]) -> list[Any]:
        values = np.array([frame.values for frame in frames], dtype=float).reshape(len(frames), -1)
        columns = [np.array([frame.time_s for frame in frames]), *values.T]
        return [pa.array([frame.index for frame in frames], pa.int64()), *map(_nullable, columns)]

    return _write(path, schema, table.frames, batch)


def write_parquet_estimates(path: Path, kinds: Mapping[str, Kind], estimates: Iterator[EstimateEntry]) -> int:
    """Write estimates of columns of these kinds, and return how many; OSError as the disk does."""
    import pyarrow as pa

    text = pa.string()
    types = {"number": pa.float64(), "integer": pa.int64(), "string": text, "strings": pa.list_(text)}
    columns = _estimate_columns(kinds)
    schema = pa.schema([(name, types[kind]) for name, kind, _ in columns])

    def column(kind: str, values: list[Any]) -> Any:
        if kind == "number":
            return _nullable(np.array([math.nan if one is None else one for one in values], dtype=float))
        return pa.array(values, types[kind])

    def batch(entries: Sequence[EstimateEntry]) -> list[Any]:
        return [column(kind, [value_of(entry) for entry in entries]) for _, kind, value_of in columns]

    return _write(path, schema, estimates, batch)


def _write(path: Path, schema: "pa.Schema", entries: Iterator[Any], columns: Any) -> int:
    import pyarrow as pa
    import pyarrow.parquet as pq

    count = 0
    with pq.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True) as writer:
        while batch := list(islice(entries, _rows(len(schema)))):
            writer.write_batch(pa.record_batch(columns(batch), schema=schema))
            count += len(batch)
    return count


def _rows(columns: int) -> int:
    return max(1, min(65536, _CELLS // max(columns, 1)))


def _nullable(values: np.ndarray) -> Any:
    import pyarrow as pa

    return pa.array(values, pa.float64(), mask=~np.isfinite(values))


def _floats(column: Any) -> np.ndarray:
    import pyarrow as pa

    return column.cast(pa.float64()).to_numpy(zero_copy_only=False)


def _counted(index: Any, path: Path) -> int:
    if isinstance(index, int) and index >= 0:
        return index
    raise RecordingError(f"the column {INDEX!r} of {path} holds {index!r}: frames are counted from 0")


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]


def convert_frames(
    source: Path, target: Path, *, form: RecordingSettings = FOUND, overwrite: bool = False
) -> int:
    """Write the frames of one file as another, and return how many; form: how a CSV is written, as far
    as it is told.

    Raises: RecordingError when the source cannot be read or has no channels, both are sessions (frames alone
    would lose its bytes and estimates), a suffix is none of `SUFFIXES`, the target cannot be written, or it
    exists and is not to be overwritten.
    """
    kinds = suffix(source), suffix(target)
    if kinds == (SESSION, SESSION):
        raise RecordingError(f"{source} and {target} are both sessions: copy the file")
    table = READERS[kinds[0]](source) if kinds[0] in READERS else read_csv(source, form)
    if not table.channels:
        raise RecordingError(f"{source} has no channels, hence no frames to convert")
    write = WRITERS[kinds[1]]
    return _create(target, lambda path: write(path, table), overwrite=overwrite)


def convert_estimates(source: Path, target: Path, *, overwrite: bool = False) -> int:
    """Write the estimates of a session as CSV or Parquet, and return how many.

    Raises: RecordingError as `convert_frames`, and when the source is no session or holds no estimates.
    """
    if suffix(source) != SESSION or suffix(target) == SESSION:
        raise RecordingError(f"estimates are taken out of a {SESSION} into .csv, .csv.gz or .parquet")
    session = RecordedSession(source)
    kinds = dict(session.info.estimates)
    if not kinds:
        raise RecordingError(f"{source} holds no estimates")
    write = (
        write_parquet_estimates
        if suffix(target) == ".parquet"
        else partial(write_csv_estimates, compressed=suffix(target) == ".csv.gz")
    )
    return _create(target, lambda path: write(path, kinds, session.estimates()), overwrite=overwrite)


def suffix(path: Path) -> str:
    """Which of `SUFFIXES` a file has; RecordingError when none."""
    for known in sorted(SUFFIXES, key=len, reverse=True):
        if path.name.lower().endswith(known):
            return known
    raise RecordingError(f"{path} is no kind of recording: its name must end in {', '.join(SUFFIXES)}")


def _read_session(path: Path) -> FrameTable:
    session = RecordedSession(path)
    info = session.info
    return FrameTable(path, info.channels, session.frames(), device=info.device, started=info.started)


def _write_session(path: Path, table: FrameTable) -> int:
    info = SessionInfo(
        device=table.device,
        command=f"convert {table.source.name}",
        started=table.started,
        channels=table.channels,
    )
    count = 0
    with SessionWriter(path, info) as writer:
        for frame in table.frames:
            writer.add(frame)
            count += 1
    return count


READERS: dict[str, Callable[[Path], FrameTable]] = {
    SESSION: _read_session,
    ".parquet": read_parquet,
}
WRITERS: dict[str, Callable[[Path, FrameTable], int]] = {
    SESSION: _write_session,
    ".csv": partial(write_csv, compressed=False),
    ".csv.gz": partial(write_csv, compressed=True),
    ".parquet": write_parquet,
}


def _create(target: Path, write: Callable[[Path], int], *, overwrite: bool) -> int:
    """Write a file beside the target and put it in its place when it is whole."""
    if target.exists() and not overwrite:
        raise RecordingError(f"{target} exists: give another name, or --force to overwrite it")
    try:
        with put_in_place(target) as part:
            return write(part)
    except OSError as error:
        raise RecordingError(f"cannot write {target}: {error.strerror or error}") from error
