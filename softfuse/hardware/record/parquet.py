"""Frames and estimates as Parquet: one column each, 64 bit floats, null where missing, compressed by zstd."""

import math
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, Kind
from softfuse.hardware.record.frame_table import TIME, FrameTable

if TYPE_CHECKING:
    import pyarrow as pa

INDEX = "index"
_CELLS = 1 << 20
"""Numbers that are held at a time."""


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


def write_parquet_estimates(path: Path, kinds: dict[str, Kind], estimates: Iterator[EstimateEntry]) -> int:
    """Write estimates of columns of these kinds, and return how many; OSError as the disk does."""
    import pyarrow as pa

    types = {"number": pa.float64(), "string": pa.string()}
    schema = pa.schema(
        [
            (TIME, pa.float64()),
            ("frame", pa.int64()),
            ("sensed", pa.int64()),
            *((name, types[kind]) for name, kind in kinds.items()),
            ("latency_ms", pa.float64()),
            ("end_to_end_ms", pa.float64()),
            ("status", pa.list_(pa.string())),
        ]
    )

    def batch(entries: Sequence[EstimateEntry]) -> list[Any]:
        def numbers(values: list[Any]) -> Any:
            return _nullable(
                np.array([math.nan if value is None else value for value in values], dtype=float)
            )

        def column(name: str, kind: Kind) -> Any:
            values = [entry.fields[name] for entry in entries]
            return pa.array(values, pa.string()) if kind == "string" else numbers(values)

        return [
            numbers([entry.time_s for entry in entries]),
            pa.array([entry.frame for entry in entries], pa.int64()),
            pa.array([entry.sensed for entry in entries], pa.int64()),
            *(column(name, kind) for name, kind in kinds.items()),
            numbers([entry.latency_ms for entry in entries]),
            numbers([entry.end_to_end_ms for entry in entries]),
            pa.array([list(entry.status) for entry in entries], pa.list_(pa.string())),
        ]

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
