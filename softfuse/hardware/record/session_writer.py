"""A session into an MCAP file, crash-safe: what is older than a second survives a kill -9.

    /source/<k>/bytes   what came from source k, untouched; application/octet-stream
    /frame              frames of all devices; JSON
    /estimate           what was estimated; JSON
    /notice             what people should know; JSON

Log and publish times are the host's in ns; a frame's is its own time, if that is known. What is known before
the first byte is the metadata "softfuse" and "source/<k>" and the attachment "config.toml". Opens in whatever
reads MCAP (https://mcap.dev/spec), such as Foxglove.

Entries are gathered in MCAP chunks, compressed by zstd, each handed to the operating system when it is half a
second old or full. What was handed over survives the end of the process, not of the machine's power.
"""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from io import BufferedWriter, FileIO
from pathlib import Path
from types import TracebackType
from typing import Self

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import (
    LONGEST_JSON,
    Entry,
    EstimateEntry,
    EstimateFormat,
    FrameEntry,
    FrameFormat,
    SessionInfo,
    estimate_schema,
    frame_schema,
    notice_schema,
    write_notice,
)
from softfuse.hardware.stream import Chunk, Notice

PROFILE = "x-softfuse"
"""The MCAP profile that tells a session from other files."""
FORMAT = "1"
"""The version of what a session's topics hold."""
FLUSH_EVERY_S = 0.5
_TIMES_END_S = 2.0**64 / 1e9 - 1
_CHUNK_BYTES = 512 * 1024
_BUFFER_BYTES = 1024 * 1024


def nanoseconds(host_s: float) -> int:
    """The nearest nanosecond to a time [s]; ValueError outside of the 64 bits that MCAP has.

    Divided by 10⁹ it gives back a time after April 1970 bit for bit, since such times are 2 ns or more apart.
    """
    seconds = int(host_s)
    # The fraction is exact; the product with 10⁹ of a time since the epoch would be off by 128 ns.
    found = 1_000_000_000 * seconds + round(1e9 * (host_s - seconds))
    if not 0 <= found < 1 << 64:
        raise ValueError(f"a session cannot hold the time {host_s!r} s: count from the epoch")
    return found


class SessionWriter:
    """Writes a session; for one thread. Whoever has nothing to write calls `flush` every half second.

    Every method raises OSError as the disk does. The file is then closed after its last whole chunk, and from
    there on every call but `close` raises the same error.
    """

    def __init__(self, path: str | Path, info: SessionInfo) -> None:
        """Begin a file; RecordingError when it exists or cannot be made."""
        self.path = Path(path)
        self.info = info
        self._frames = FrameFormat(info.channels)
        self._estimates = EstimateFormat(info.estimates)
        self._latest_ns = 0
        self._error: OSError | None = None
        self._closed = False
        try:
            self._raw = FileIO(self.path, "xb")
        except FileExistsError as error:
            raise RecordingError(
                f"{self.path} exists and is not overwritten: give another name or remove it"
            ) from error
        except OSError as error:
            raise RecordingError(f"cannot write {self.path}: {error.strerror or error}") from error
        self._stream = BufferedWriter(self._raw, _BUFFER_BYTES)
        self._whole = 0
        self._added = self._handed_over = 0
        try:
            self._begin()
        except OSError as error:
            with suppress(OSError):
                self.path.unlink()
            raise RecordingError(f"cannot write {self.path}: {error.strerror or error}") from error
        self._due = time.monotonic() + FLUSH_EVERY_S

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def pending(self) -> int:
        """Entries added and not yet handed over; after a failure of the disk those that are lost."""
        return self._added - self._handed_over

    def add(self, entry: Entry) -> None:
        """Add an entry; ValueError for a source, channels or a column that the session has not, a value not
        of its column's kind, and one that is longer than a reader takes.
        """
        match entry:
            case Chunk(source=source):
                if not 0 <= source < len(self._source_ids):
                    raise ValueError(
                        f"the session has {len(self._source_ids)} sources, none of number {source}"
                    )
                self._add(self._source_ids[source], nanoseconds(entry.host_s), entry.data)
            case FrameEntry():
                known = 0 <= entry.time_s < _TIMES_END_S
                at_ns = nanoseconds(entry.time_s) if known else self._latest_ns
                self._add_json(self._frame_id, at_ns, self._frames.write(entry))
            case EstimateEntry():
                at_ns = nanoseconds(entry.host_s)
                self._add_json(self._estimate_id, at_ns, self._estimates.write(entry))
            case Notice():
                self._add_json(self._notice_id, nanoseconds(entry.host_s), write_notice(entry))

    def flush(self) -> None:
        """Hand over to the operating system what has been added."""
        self._writing(self._hand_over)

    def close(self) -> None:
        """End the file with its index; nothing when it is closed."""
        if self._closed:
            return
        self._writing(self._finish)

    def _begin(self) -> None:
        from mcap.writer import CompressionType, Writer

        info = self.info
        mcap = Writer(self._stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._mcap = mcap

        def head() -> None:
            mcap.start(profile=PROFILE, library=f"softfuse {info.version}")
            mcap.add_metadata("softfuse", _encodable(_described(info)))
            for k, source in enumerate(info.sources):
                where = {"url": source.url, "driver": source.driver}
                mcap.add_metadata(f"source/{k}", _encodable(where))
            if info.config is not None:
                mcap.add_attachment(
                    create_time=0, log_time=0, name="config.toml", media_type="text/toml", data=info.config
                )
            self._hand_over()

        self._writing(head)

        def json_topic(topic: str, name: str, schema: bytes) -> int:
            return mcap.register_channel(topic, "json", mcap.register_schema(name, "jsonschema", schema))

        self._frame_id = json_topic("/frame", "softfuse.Frame", frame_schema(info))
        self._estimate_id = json_topic("/estimate", "softfuse.Estimate", estimate_schema(info))
        self._notice_id = json_topic("/notice", "softfuse.Notice", notice_schema())
        self._source_ids = [
            mcap.register_channel(f"/source/{k}/bytes", "application/octet-stream", 0)
            for k in range(len(info.sources))
        ]

    def _add_json(self, channel: int, at_ns: int, data: bytes) -> None:
        if len(data) > LONGEST_JSON:
            raise ValueError(f"an entry of {len(data)} bytes is longer than the {LONGEST_JSON} that are read")
        self._add(channel, at_ns, data)

    def _add(self, channel: int, at_ns: int, data: bytes) -> None:
        self._latest_ns = max(self._latest_ns, at_ns)

        def add() -> None:
            self._added += 1
            self._mcap.add_message(channel, log_time=at_ns, publish_time=at_ns, data=data)
            if time.monotonic() >= self._due:
                self._hand_over()

        self._writing(add)

    def _hand_over(self) -> None:
        self._mcap.flush()
        self._whole = self._stream.tell()
        self._handed_over = self._added
        self._due = time.monotonic() + FLUSH_EVERY_S

    def _finish(self) -> None:
        self._mcap.finish()
        self._stream.flush()
        self._stream.close()
        self._closed = True

    def _writing(self, act: Callable[[], None]) -> None:
        """Act; on a failure of the disk cut the file after its last whole chunk and close it."""
        if self._error is not None:
            raise self._error
        if self._closed:
            raise ValueError(f"the session {self.path} is closed")
        try:
            act()
        except OSError as error:
            self._error = error
            self._closed = True
            # Past the buffer, which would try again to write what it still holds.
            _cut(self._raw, self._whole)
            raise


def _described(info: SessionInfo) -> dict[str, str]:
    return {
        "format": FORMAT,
        "version": info.version,
        "command": info.command,
        "device": info.device,
        "started": info.started,
        "sources": str(len(info.sources)),
        "channels": json.dumps(info.channels),
        "estimates": json.dumps(dict(info.estimates)),
    }


def _encodable(fields: dict[str, str]) -> dict[str, str]:
    # A path in a command may hold bytes that are no UTF-8, which Python keeps as lone surrogates.
    return {name: value.encode(errors="replace").decode() for name, value in fields.items()}


def _cut(raw: FileIO, size: int) -> None:
    """Close a file after its first `size` bytes."""
    if raw.closed:
        return
    with suppress(OSError):
        raw.truncate(size)
    with suppress(OSError):
        raw.close()
