"""What the test bed measures, row by row into a CSV recording that may be continued.

`time_s` (seconds since the epoch), the channels, and the columns that say what was done. Rows are handed to
the operating system every half second; one that the end of a process cut is malformed and stays alone on its
line.
"""

import os
import time
from pathlib import Path

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import FrameEntry
from softfuse.hardware.record.frame_table import csv_field, csv_header

FLUSH_S = 0.5


class CsvRecording:
    """Appends frames to a CSV file; for one thread. Its methods raise OSError as the disk does."""

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
