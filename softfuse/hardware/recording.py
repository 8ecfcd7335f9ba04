"""Recordings: CSV files of raw sensor frames, read whole whatever happened to them.

How the file is written is found or told (`softfuse.hardware.table`). A row that was cut, has an empty field
or text where a sensor's number belongs keeps its place: the fields that cannot be read are NaN and the row is
flagged. Other columns may hold what they like: what is no number is NaN there, and texts are labels. Values
are kept in the units that the column's name says (V, counts, mm, N), as recorded; only the sensing
stage turns them into SI.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.errors import RecordingError
from softfuse.hardware.table.form import FOUND
from softfuse.hardware.table.table import TIME, Table
from softfuse.robot.recording import RecordingSettings
from softfuse.sensors.frame_time import clock_of

logger = logging.getLogger(__name__)

_ROOM = 1 << 16
_NAMED = 5
_BY_NAME = "_electrode"
"""How columns end that may hold names."""


@dataclass(frozen=True)
class Labels:
    """The texts in a column."""

    texts: tuple[str, ...]
    code: Int[np.ndarray, " n"]
    """(n,) which of them, -1 where there is none."""


@dataclass(frozen=True)
class Recording:
    """A recording in memory: n frames."""

    path: Path
    """Where it came from."""
    time_s: Float[np.ndarray, " n"]
    """(n,) time [s], NaN where it could not be read."""
    columns: dict[str, Float[np.ndarray, " n"]]
    """Every column with numbers, `time_s` included, by name; (n,) each, NaN where there is none."""
    line: Int[np.ndarray, " n"]
    """(n,) line number in the file, from 1; of a table with a row for each reading that of the first."""
    malformed: Bool[np.ndarray, " n"]
    """(n,) rows with too few or too many fields, or without a number where one is required."""
    disordered: Bool[np.ndarray, " n"]
    """(n,) rows whose time does not count, see `softfuse.sensors.frame_time`."""
    complete: bool
    """False where a compressed file ends early."""
    labels: dict[str, Labels] = field(default_factory=dict)
    """Of every column with texts."""

    def matrix(self, names: Sequence[str]) -> Float[np.ndarray, "n m"]:
        """The named columns, none or more, side by side: (n, m); RecordingError for a name that the file
        lacks.
        """
        missing = [name for name in names if name not in self.columns]
        if missing:
            listed = ", ".join(repr(name) for name in missing)
            noun = "column" if len(missing) == 1 else "columns"
            raise RecordingError(
                f"the recording {self.path} lacks the {noun} {listed}; it has: {', '.join(self.columns)}"
            )
        return np.array([self.columns[name] for name in names]).reshape(len(names), len(self.time_s)).T

    def numbered(self, name: str, names: Sequence[str], *, unknown: float) -> Float[np.ndarray, " n"]:
        """A column (n,) that says which of some names, by its number or by itself; `unknown` where it is
        blank.

        Logs a warning for a text that is none of the names; RecordingError when there is no such column.
        """
        labels = self.labels.get(name)
        values = self.columns.get(name)
        if labels is None or values is None:
            return self.matrix([name])[:, 0] if labels is None else self._named(name, labels, names, unknown)
        return np.where(labels.code >= 0, self._named(name, labels, names, unknown), values)

    def _named(
        self, name: str, labels: Labels, names: Sequence[str], unknown: float
    ) -> Float[np.ndarray, " n"]:
        strange = [text for text in labels.texts if text not in names]
        if strange:
            logger.warning(
                "%s: the column %r says %r, which is none of %s: taken as blank",
                *(self.path, name, strange[0], ", ".join(names)),
            )
        number = [float(names.index(text)) if text in names else unknown for text in labels.texts]
        return np.array([*number, unknown])[labels.code]

    def rows(self, at: Int[np.ndarray, " m"]) -> "Recording":
        """The recording of some of its frames (m,), by their numbers."""
        return replace(
            self,
            time_s=self.time_s[at],
            columns={name: column[at] for name, column in self.columns.items()},
            line=self.line[at],
            malformed=self.malformed[at],
            disordered=self.disordered[at],
            labels={name: Labels(each.texts, each.code[at]) for name, each in self.labels.items()},
        )


def read_recording(path: str | Path, required: Sequence[str], form: RecordingSettings = FOUND) -> Recording:
    """Read a recording from .csv or .csv.gz.

    Args: path of the file; required: names of the channels that must be there besides the time; form: how the
    file is written, as far as it is told. Other columns (truth, for instance) are read when present.
    Returns: Recording, with no frames when the file holds a header only.
    Raises: RecordingError naming the file when it cannot be opened, is empty, has no header, names a
    column twice or lacks a required one.
    Logs a warning for what cannot be read, with the columns and lines, for times that do not count, and for
    samples whose truth is not known.
    """
    path = Path(path)
    table = Table(path, required, form)
    names = (TIME, *table.channels)
    columns = {name: _Growing(np.float64, np.nan) for name in names}
    labels = dict[int, _Growing]()
    line, malformed = _Growing(np.int32, 0), _Growing(np.bool_, False)
    for block in table.blocks():
        for name, values in zip(names, (block.time_s, *block.values), strict=True):
            # What holds no numbers takes no memory, as long as it does not.
            if columns[name].count or np.isfinite(values).any():
                columns[name].fill(line.count)
                columns[name].add(values)
        for c, codes in block.labels.items():
            held = labels.setdefault(c, _Growing(np.int16, -1))
            held.fill(line.count)
            held.add(codes)
        line.add(block.line)
        malformed.add(block.malformed)
    n = line.count
    texts = {table.channels[c]: tuple(named) for c, named in table.labels.items() if c in labels and named}
    found = dict[str, Labels]()
    for c, held in labels.items():
        held.fill(n)
        if table.channels[c] in texts:
            found[table.channels[c]] = Labels(texts[table.channels[c]], held.array)
    kept = {name: column for name, column in columns.items() if name not in found or column.count}
    for column in kept.values():
        column.fill(n)
    arrays = {name: column.array for name, column in kept.items()}
    clock = clock_of(arrays[TIME])
    recording = Recording(
        path=path,
        time_s=arrays[TIME],
        columns=arrays,
        line=line.array,
        malformed=malformed.array,
        disordered=~clock.counts,
        complete=table.complete,
        labels=found,
    )
    _tell_malformed(recording, [TIME, *required])
    _tell_truth(recording)
    _tell_clock(recording, clock.anew)
    return recording


class _Growing:
    """An array that grows: what is not used of it takes no memory yet."""

    def __init__(self, kind: type, blank: float):
        self._array, self._blank, self.count = np.empty(_ROOM, kind), blank, 0

    @property
    def array(self) -> np.ndarray:
        return self._array[: self.count]

    def add(self, values: np.ndarray) -> None:
        self._reserve(self.count + len(values))
        self._array[self.count : self.count + len(values)] = values
        self.count += len(values)

    def fill(self, count: int) -> None:
        """Fill up to so many."""
        if count > self.count:
            self._reserve(count)
            self._array[self.count : count] = self._blank
            self.count = count

    def _reserve(self, count: int) -> None:
        if count > len(self._array):
            larger = np.empty(max(count, 2 * len(self._array)), self._array.dtype)
            larger[: self.count] = self.array
            self._array = larger


def _lines(recording: Recording, at: Bool[np.ndarray, " n"]) -> str:
    lines = recording.line[at][:_NAMED]
    return (
        ("line " if at.sum() == 1 else "lines ")
        + ", ".join(map(str, lines))
        + (" ..." if at.sum() > _NAMED else "")
    )


def _tell_malformed(recording: Recording, required: Sequence[str]) -> None:
    at = recording.malformed
    if not at.any():
        return
    lost = {name: int((np.isnan(recording.columns[name]) & at).sum()) for name in required}
    told = ", ".join(f"{name} in {count}" for name, count in lost.items() if count) or "surplus fields"
    logger.warning(
        "%s: %d rows have fields that cannot be read: %s (%s)",
        *(recording.path, at.sum(), told, _lines(recording, at)),
    )


def _tell_truth(recording: Recording) -> None:
    """Say which truth is not known where a sample counts, and which texts stand among numbers."""
    sample = recording.columns.get("sample")
    for name, column in recording.columns.items():
        labels = recording.labels.get(name)
        text = np.zeros(len(column), bool) if labels is None else labels.code >= 0
        blank = np.isnan(column) & ~text if sample is not None else text & False
        blank &= name.startswith("true_") & (np.nan_to_num(0 if sample is None else sample) > 0)
        if blank.any():
            logger.warning(
                "%s: %r is blank in %d samples: they have no such truth (%s)",
                *(recording.path, name, blank.sum(), _lines(recording, blank)),
            )
        if text.any() and labels is not None and not name.endswith(_BY_NAME):
            logger.warning(
                "%s: %r holds text in %d rows, such as %r: no numbers there (%s)",
                *(recording.path, name, text.sum(), labels.texts[0], _lines(recording, text)),
            )


def _tell_clock(recording: Recording, anew: Bool[np.ndarray, " n"]) -> None:
    """Say where the time does not count, and where the clock was taken anew."""
    if recording.disordered.any():
        logger.warning(
            "%s: the time of %d frames is missing, no later or far ahead, they do not count (%s)",
            *(recording.path, recording.disordered.sum(), _lines(recording, recording.disordered)),
        )
    for i in np.flatnonzero(anew)[:_NAMED]:
        logger.warning(
            "%s: the clock begins anew in line %d: from %.6g s on",
            *(recording.path, recording.line[i], recording.time_s[i]),
        )
