"""Frames as a table, on their way from one kind of file to another, and as CSV.

The CSV is that of `softfuse.hardware.recording`: `time_s` and the channels, one row a frame. Every number has
the fewest digits that give back the same 64 bits; what is missing or not finite is an empty field.
"""

import csv
import gzip
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from itertools import count
from pathlib import Path
from typing import TextIO

import numpy as np

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry
from softfuse.hardware.table.form import FOUND, TableForm
from softfuse.hardware.table.table import TIME, Table

logger = logging.getLogger(__name__)


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


def read_csv(path: Path, form: TableForm = FOUND) -> FrameTable:
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


def write_csv_estimates(
    path: Path, columns: tuple[str, ...], estimates: Iterator[EstimateEntry], *, compressed: bool
) -> int:
    """Write estimates, one row each, and return how many; OSError as the disk does."""
    written = 0
    with _text(path, compressed) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([TIME, "frame", "sensed", *columns, "latency_ms", "end_to_end_ms", "status"])
        for entry in estimates:
            found = [entry.time_s, entry.frame, entry.sensed, *(entry.fields[name] for name in columns)]
            fields = [csv_field(value) for value in (*found, entry.latency_ms, entry.end_to_end_ms)]
            writer.writerow([*fields, "; ".join(entry.status)])
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
