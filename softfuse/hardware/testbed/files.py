"""The files of a test bed: what they hold already, and what comes in addition."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count, takewhile
from pathlib import Path

import numpy as np

from softfuse.errors import RecordingError
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.record.convert import csv_field, csv_header
from softfuse.hardware.record.entries import FrameEntry, SessionInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.recording import read_recording
from softfuse.hardware.stream import Chunk, HostClock, Notice
from softfuse.hardware.testbed.places import LABELS, Point, next_press, pressed, remaining

FLUSH_S = 0.5
_SESSION, _TABLE = ".mcap", ".csv"


class CsvRecording:
    """Appends frames to a CSV recording, new or begun before; for one thread. Its methods raise OSError as
    the disk does.

    Rows are handed to the operating system every half second; one that the end of a process cut is malformed
    and stays alone on its line.
    """

    def __init__(self, path: Path, channels: tuple[str, ...]) -> None:
        """Begin a file, or go on with one of the same columns.

        RecordingError for one of other columns, one that cannot be written, and names that CSV cannot hold.
        """
        header = csv_header(channels)
        try:
            begun = _beginning(path, len(header.encode()) + 3)
            self._stream = path.open("a", encoding="utf-8", newline="")
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror or error}") from error
        if begun is None:
            self._stream.write(header)
        elif begun.removeprefix(b"\xef\xbb\xbf").splitlines()[:1] != [header.strip("\n").encode()]:
            self._stream.close()
            raise RecordingError(
                f"{path} has other columns than this configuration and these sensors: give another name"
            )
        elif not _ends_a_line(path):
            self._stream.write("\n")
        self._stream.flush()
        self._due = time.monotonic() + FLUSH_S

    def frame(self, entry: FrameEntry) -> None:
        """Append a frame."""
        fields = (csv_field(value) for value in (float(entry.time_s), *entry.values.tolist()))
        self._stream.write(",".join(fields) + "\n")
        if time.monotonic() >= self._due:
            self._stream.flush()
            self._due = time.monotonic() + FLUSH_S

    def close(self) -> None:
        """Write what waits and close the file."""
        self._stream.close()


def _beginning(path: Path, size: int) -> bytes | None:
    """The first bytes of a file, None where there is none or it is empty."""
    try:
        with path.open("rb") as stream:
            return stream.read(size) or None
    except FileNotFoundError:
        return None


def _ends_a_line(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        return stream.read() == b"\n"


def done_already(files: Sequence[Path], places: Sequence[Point], levels: int) -> tuple[list[Point], int]:
    """The places [m] of which some file lacks a sample of one of so many levels, and the first number that no
    press has; RecordingError for files of another kind, or that cannot be read.
    """
    if len({path.resolve() for path in files}) < len(files):
        raise RecordingError(f"--out {', '.join(map(str, files))}: give each file once")
    missing: set[Point] = set()
    first = 0
    for path in files:
        pressed_here: list[Point] = []
        for columns in _columns(path):
            pressed_here += pressed(columns, levels)
            first = max(first, next_press(columns))
        missing |= set(remaining(places, pressed_here))
    return [at for at in places if at in missing], first


class Outputs:
    """Writes what is gathered to all files: a recording is continued, a session gets another beside it."""

    def __init__(
        self, files: Sequence[Path], info: SessionInfo, clock: HostClock, tell: Callable[[Notice], None]
    ) -> None:
        """RecordingError where a file cannot be written or has other columns."""
        self._tables: list[CsvRecording] = []
        self._recorders: list[Recorder] = []
        self.files: list[Path] = []
        """Those that are written."""
        try:
            for path in files:
                if _kind(path) == _TABLE:
                    self._tables.append(CsvRecording(path, info.channels))
                else:
                    path = next(part for part in _numbered(path) if not part.exists())
                    self._recorders.append(Recorder(path, info, clock, tell))
                self.files.append(path)
        except RecordingError:
            self.close()
            raise

    def write(self, entry: Chunk | FrameEntry | Notice) -> None:
        """Write an entry; OSError as the disk of a recording does."""
        for recorder in self._recorders:
            recorder.put(entry)
        if isinstance(entry, FrameEntry):
            for table in self._tables:
                table.frame(entry)

    @property
    def lost(self) -> int:
        """Entries that are in no session."""
        return sum(recorder.lost for recorder in self._recorders)

    def close(self) -> None:
        """Write what waits, and close."""
        for recorder in self._recorders:
            recorder.close()
        for table in self._tables:
            table.close()


def _kind(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (_SESSION, _TABLE):
        raise RecordingError(f"{path} is no kind of recording: its name must end in {_SESSION} or {_TABLE}")
    return suffix


def _columns(path: Path) -> list[dict[str, np.ndarray]]:
    """The columns that say what was done, of a recording or of each of a session's files."""
    if _kind(path) == _TABLE:
        empty = not path.exists() or not path.stat().st_size
        return [] if empty else [read_recording(path, LABELS).columns]
    return [_session_columns(part) for part in takewhile(Path.exists, _numbered(path))]


def _session_columns(path: Path) -> dict[str, np.ndarray]:
    session = RecordedSession(path)
    channels = session.info.channels
    lacking = [name for name in LABELS if name not in channels]
    if lacking:
        raise RecordingError(
            f"{path} is no session of a test bed, it lacks {lacking[0]!r}: give another name"
        )
    take = [channels.index(name) for name in LABELS]
    rows = np.array([entry.values[take] for entry in session.frames()]).reshape(-1, len(take))
    return dict(zip(LABELS, rows.T, strict=True))


def _numbered(path: Path) -> Iterator[Path]:
    """The names that the files of a session may have, in order."""
    return (path if k == 1 else path.with_stem(f"{path.stem}-{k}") for k in count(1))
