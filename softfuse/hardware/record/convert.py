"""Sessions, CSV and Parquet into each other; which is which is told by the file's suffix.

A session is a .mcap file, a recording .csv or .csv.gz. What is converted are the frames (every number bit for
bit, missing stays missing) or the estimates of a session. A file appears under its name when it is whole.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import SessionInfo
from softfuse.hardware.record.frame_table import (
    FrameTable,
    read_csv,
    read_parquet,
    write_csv,
    write_csv_estimates,
    write_parquet,
    write_parquet_estimates,
)
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.record.session_writer import SessionWriter
from softfuse.hardware.table.form import FOUND, TableForm
from softfuse.io.result_folder import put_in_place

SUFFIXES = (".mcap", ".csv", ".csv.gz", ".parquet")
SESSION = ".mcap"


def convert_frames(source: Path, target: Path, *, form: TableForm = FOUND, overwrite: bool = False) -> int:
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
    if suffix(target) == ".parquet":
        return _create(
            target,
            lambda path: write_parquet_estimates(path, kinds, session.estimates()),
            overwrite=overwrite,
        )
    compressed = suffix(target) == ".csv.gz"
    return _create(
        target,
        lambda path: write_csv_estimates(path, kinds, session.estimates(), compressed=compressed),
        overwrite=overwrite,
    )


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
