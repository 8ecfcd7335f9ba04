"""Recordings: CSV files of raw sensor frames, read whole whatever happened to them.

One header line with the columns' names, one row a frame. A row that was cut, has an empty field or text where
a number belongs keeps its place: the fields that cannot be read are NaN and the row's line number is listed.
The last field of a cut row is not believed either, since the cut may have shortened the number. Values are
kept in the units that the column's name says (V, counts, mm, N), as recorded; only the sensing stage turns
them into SI.
"""

import csv
import gzip
import logging
import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.errors import RecordingError

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Recording:
    """A recording in memory: n frames."""

    path: Path
    """Where it came from."""
    time_s: Float[np.ndarray, " n"]
    """(n,) time [s], NaN where it could not be read."""
    columns: dict[str, Float[np.ndarray, " n"]]
    """Every column of the file, `time_s` included, by name; (n,) each, NaN where a field cannot be read."""
    line: Int[np.ndarray, " n"]
    """(n,) line number in the file, from 1 for the header."""
    malformed: Bool[np.ndarray, " n"]
    """(n,) rows with fields that could not be read, too few or too many fields."""
    disordered: Bool[np.ndarray, " n"]
    """(n,) rows whose time is missing or not later than every time before."""
    complete: bool
    """False where a compressed file ends early."""

    def matrix(self, names: Sequence[str]) -> Float[np.ndarray, "n m"]:
        """The named columns, none or more, side by side: (n, m); RecordingError for a name that the file
        lacks.
        """
        missing = [name for name in names if name not in self.columns]
        if missing:
            raise RecordingError(_missing_message(self.path, missing, self.columns))
        return np.array([self.columns[name] for name in names]).reshape(len(names), len(self.time_s)).T

    @property
    def labels(self) -> dict[str, tuple[str, ...]]:
        """Texts by column."""
        return {}

    def numbered(self, name: str, names: Sequence[str], *, unknown: float) -> Float[np.ndarray, " n"]:
        """A column (n,) that says which of some names, by its number; `unknown` where it is blank."""
        del names
        values = self.matrix([name])[:, 0]
        return np.where(np.isfinite(values), values, unknown)

    def rows(self, at: Int[np.ndarray, " m"]) -> "Recording":
        """The recording of some of its frames (m,), by their numbers."""
        return replace(
            self,
            time_s=self.time_s[at],
            columns={name: column[at] for name, column in self.columns.items()},
            line=self.line[at],
            malformed=self.malformed[at],
            disordered=self.disordered[at],
        )


def read_recording(path: str | Path, required: Sequence[str]) -> Recording:
    """Read a recording from .csv or .csv.gz.

    Args: path of the file; required: names of the columns that must be there besides `time_s`. Other columns
    (truth, for instance) are read when present.
    Returns: Recording, with no frames when the file holds a header only.
    Raises: RecordingError naming the file when it cannot be opened, is empty, has no header, names a
    column twice or lacks a required one.
    """
    path = Path(path)
    try:
        opened = _open(path)
    except OSError as error:
        raise RecordingError(f"cannot open the recording {path}: {error.strerror or error}") from error
    with opened as stream:
        rows, complete = _rows(path, stream)
    if not rows:
        raise RecordingError(f"the recording {path} is empty: its first line must name the columns")
    names = [name.strip().lstrip("\ufeff") for name in rows[0][1]]
    _check_header(path, names, ["time_s", *required])
    values = np.empty((len(rows) - 1, len(names)))
    malformed = np.zeros(len(rows) - 1, bool)
    for i, (_, fields) in enumerate(rows[1:]):
        values[i], malformed[i] = _numbers(fields, len(names))
    time = values[:, names.index("time_s")]
    latest = np.concatenate([[-np.inf], np.fmax.accumulate(time)[:-1]]) if time.size else time
    line = np.array([number for number, _ in rows[1:]], dtype=int)
    if malformed.any():
        first = ", ".join(str(number) for number in line[malformed][:5])
        logger.warning(
            "%s: %d rows have fields that cannot be read (lines %s ...)", path, malformed.sum(), first
        )
    return Recording(
        path=path,
        time_s=time,
        columns={name: values[:, j] for j, name in enumerate(names)},
        line=line,
        malformed=malformed,
        disordered=~(time > np.where(np.isnan(latest), -np.inf, latest)),
        complete=complete,
    )


def _open(path: Path) -> TextIO:
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8", errors="replace", newline="")
    return path.open("rt", encoding="utf-8", errors="replace", newline="")


def _rows(path: Path, stream: TextIO) -> tuple[list[tuple[int, list[str]]], bool]:
    """All rows that are not blank with their line numbers, and whether the file ended properly."""
    rows: list[tuple[int, list[str]]] = []
    try:
        rows.extend((number, fields) for number, fields in _parse(stream) if fields)
    except gzip.BadGzipFile as error:
        raise RecordingError(f"{path} is not a gzip file: {error}") from error
    except csv.Error as error:
        raise RecordingError(f"{path} is no table of numbers: {error}") from error
    except (EOFError, OSError, zlib.error) as error:
        logger.warning("%s ends early: %s", path, error)
        return rows, False
    return rows, True


def _parse(stream: TextIO) -> Iterator[tuple[int, list[str]]]:
    # Quotes have no meaning in a table of numbers; a stray one must not swallow the lines after it.
    reader = csv.reader(stream, quoting=csv.QUOTE_NONE)
    for fields in reader:
        yield reader.line_num, fields


def _check_header(path: Path, names: list[str], required: list[str]) -> None:
    if all(_number(name) is not None for name in names):
        raise RecordingError(f"{path} starts with numbers: its first line must name the columns")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(f"the recording {path} names the column {twice[0]!r} twice: rename or drop one")
    missing = [name for name in required if name not in names]
    if missing:
        raise RecordingError(_missing_message(path, missing, names))


def _missing_message(path: Path, missing: Sequence[str], present: Sequence[str] | dict) -> str:
    listed = ", ".join(repr(name) for name in missing)
    noun = "column" if len(missing) == 1 else "columns"
    return f"the recording {path} lacks the {noun} {listed}; it has: {', '.join(present)}"


def _number(field: str) -> float | None:
    """The finite number in a field, or None."""
    try:
        value = float(field)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _numbers(fields: list[str], count: int) -> tuple[list[float], bool]:
    """`count` numbers, NaN where a field cannot be read, and whether the row is malformed."""
    if len(fields) == count:
        try:
            values = [float(field) for field in fields]
        except ValueError:
            pass
        else:
            if math.isfinite(sum(values)):
                return values, False
    if len(fields) < count:
        fields = fields[:-1]
    values = [math.nan if (value := _number(field)) is None else value for field in fields[:count]]
    return values + [math.nan] * (count - len(values)), True
