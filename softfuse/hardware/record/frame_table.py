"""Frames as a table, on their way from one kind of file to another, and as CSV.

The CSV is that of `softfuse.hardware.recording`: `time_s` and the channels, one row a frame. Every number has
the fewest digits that give back the same 64 bits; what is missing or not finite is an empty field.
"""

import csv
import gzip
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry
from softfuse.hardware.recording import read_recording

TIME = "time_s"


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


def read_csv(path: Path) -> FrameTable:
    """The frames of a recording, .csv or .csv.gz, numbered by row; RecordingError as `read_recording`."""
    recording = read_recording(path, [])
    channels = tuple(name for name in recording.columns if name != TIME)
    values = recording.matrix(channels)
    rows = enumerate(zip(recording.time_s.tolist(), values, strict=True))
    return FrameTable(path, channels, (FrameEntry(i, at, row) for i, (at, row) in rows))


def write_csv(path: Path, table: FrameTable, *, compressed: bool) -> int:
    """Write frames, and return how many.

    Raises: RecordingError for a channel whose name a header cannot hold; OSError as the disk does.
    """
    header = csv_header(table.channels)
    count = 0
    with _text(path, compressed) as stream:
        stream.write(header)
        for frame in table.frames:
            fields = (csv_field(value) for value in (float(frame.time_s), *frame.values.tolist()))
            stream.write(",".join(fields) + "\n")
            count += 1
    return count


def write_csv_estimates(
    path: Path, columns: tuple[str, ...], estimates: Iterator[EstimateEntry], *, compressed: bool
) -> int:
    """Write estimates, one row each, and return how many; OSError as the disk does."""
    count = 0
    with _text(path, compressed) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([TIME, "frame", "sensed", *columns, "latency_ms", "end_to_end_ms", "status"])
        for entry in estimates:
            found = [entry.time_s, entry.frame, entry.sensed, *(entry.fields[name] for name in columns)]
            fields = [csv_field(value) for value in (*found, entry.latency_ms, entry.end_to_end_ms)]
            writer.writerow([*fields, "; ".join(entry.status)])
            count += 1
    return count


def csv_header(channels: tuple[str, ...]) -> str:
    """The first line, with its end; RecordingError for a channel whose name it cannot hold."""
    for name in channels:
        if name != name.strip().lstrip("\ufeff") or any(sign in name for sign in ",\r\n"):
            raise RecordingError(f"the channel {name!r} cannot be named in a CSV file: rename it")
    return ",".join((TIME, *channels)) + "\n"


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
