"""A session from an MCAP file, in the order in which it was written, also of a file that was cut anywhere, is
damaged or hostile.

    file = magic, records, magic;   record = opcode u8 | length u64 | content

(https://mcap.dev/spec; little endian). A length in the file is believed only up to what the file has left,
and what it leads to in memory is bounded by `LARGEST_RECORD`.
"""

import logging
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeVar

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import (
    Entry,
    EstimateEntry,
    EstimateFormat,
    FrameEntry,
    FrameFormat,
    Kind,
    SessionInfo,
    SourceInfo,
    parse_json,
    read_notice,
)
from softfuse.hardware.record.session_writer import FORMAT, PROFILE
from softfuse.hardware.stream import Chunk, Notice

if TYPE_CHECKING:
    from mcap.data_stream import ReadDataStream


MAGIC = b"\x89MCAP0\r\n"
LARGEST_RECORD = 1 << 26
"""Bytes of the largest chunk, unpacked, or attachment that is read."""
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
logger = logging.getLogger(__name__)
T = TypeVar("T")
_HEADER, _FOOTER, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x04, 0x05, 0x06
_ATTACHMENT, _METADATA, _DATA_END = 0x09, 0x0C, 0x0F
_LARGEST_HEAD = 4 << 20
_BYTES_TOPIC = re.compile(r"/source/(0|[1-9][0-9]{0,3})/bytes", re.ASCII)
_JSON, _RAW = "json", "application/octet-stream"


class DamagedRecord(ValueError):
    """A record whose content is not what it must be."""


@dataclass(frozen=True, slots=True)
class RecordPlace:
    """Where the content of a record is in its file."""

    opcode: int
    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message of an MCAP channel."""

    channel: int
    log_ns: int
    data: bytes


def record_places(stream: BinaryIO, size: int) -> Iterator[RecordPlace]:
    """The records of a file of `size` bytes after its magic, up to the first that is cut or impossible.

    The stream may be moved between them.
    """
    position = len(MAGIC)
    while True:
        stream.seek(position)
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        opcode, length = _HEAD.unpack(head)
        position += _HEAD.size
        # No record has the opcode 0; it is what a file is filled with that lost its end to a power cut.
        if opcode == 0 or length > size - position:
            return
        yield RecordPlace(opcode, position, length)
        position += length


def content(stream: BinaryIO, place: RecordPlace, most: int = LARGEST_RECORD) -> bytes:
    """The content of a record; DamagedRecord when it has more than `most` bytes."""
    if place.length > most:
        raise DamagedRecord(f"a record has {place.length} bytes, more than the {most} that are read")
    stream.seek(place.offset)
    return stream.read(place.length)


def data_stream(data: bytes) -> "ReadDataStream":
    """A content for the readers of `mcap.records`."""
    from mcap.data_stream import ReadDataStream

    return ReadDataStream(BytesIO(data))


def chunk_records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Opcodes and contents of the records in a chunk; DamagedRecord when it cannot be unpacked."""
    unpacked = memoryview(_unpacked(data))
    position = 0
    while position + _HEAD.size <= len(unpacked):
        opcode, length = _HEAD.unpack_from(unpacked, position)
        position += _HEAD.size
        if length > len(unpacked) - position:
            raise DamagedRecord("a record in a chunk is longer than the chunk")
        yield opcode, unpacked[position : position + length]
        position += length


def raw_message(data: bytes | memoryview) -> RawMessage:
    """The message in a record's content; DamagedRecord when it is too short."""
    if len(data) < _MESSAGE_HEAD.size:
        raise DamagedRecord("a message is shorter than its head")
    channel, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(data)
    return RawMessage(channel, log_ns, bytes(data[_MESSAGE_HEAD.size :]))


def _unpacked(data: bytes) -> bytes:
    """The records of a chunk, checked against its CRC if it has one."""
    from mcap.exceptions import McapError
    from mcap.records import Chunk

    try:
        chunk = Chunk.read(data_stream(data))
    except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise DamagedRecord("the head of a chunk cannot be read") from error
    if chunk.uncompressed_size > LARGEST_RECORD:
        raise DamagedRecord(f"a chunk would unpack to {chunk.uncompressed_size} bytes")
    if chunk.compression == "zstd":
        unpacked = _unzstd(chunk.data, chunk.uncompressed_size)
    elif chunk.compression == "":
        unpacked = chunk.data
    else:
        raise DamagedRecord(f"a chunk is compressed by {chunk.compression!r}, which is not read")
    if len(unpacked) != chunk.uncompressed_size:
        raise DamagedRecord("a chunk does not unpack to the size that it tells")
    if chunk.uncompressed_crc and zlib.crc32(unpacked) != chunk.uncompressed_crc:
        raise DamagedRecord("a chunk fails its CRC")
    return unpacked


def _unzstd(data: bytes, size: int) -> bytes:
    import zstandard

    # The size that a frame itself tells would be believed without bounds by `decompress`.
    unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST_RECORD)
    try:
        with unpacker.stream_reader(data) as stream:
            return stream.read(size + 1)
    except zstandard.ZstdError as error:
        raise DamagedRecord("a chunk cannot be decompressed") from error


Reader = Callable[[RawMessage], T]


class RecordedSession:
    """A session on disk. Its entries are read anew from the file each time that they are asked for."""

    def __init__(self, path: str | Path) -> None:
        """Look through a file; one that was cut, anywhere, is read as far as it goes.

        Raises RecordingError when it cannot be opened, is no MCAP file, or was not written by softfuse.
        """
        self.path = Path(path)
        self.unreadable = 0
        """Chunks and entries that could not be read so far, because they are damaged."""
        self._channels: dict[int, tuple[str, str]] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        self._config: bytes | None = None
        with self._open() as stream:
            self.size = stream.seek(0, 2)
            """Bytes of the file."""
            self.complete, self.cut_bytes = self._survey(stream)
            """Whether the session was closed and its end is there; and how many bytes at the end of the file
            belong to something that was cut.
            """
        self.info = self._info()
        """What was known before the first byte; empty as far as the file was cut before it."""
        if not self.complete:
            logger.warning(
                "%s was not closed: it ends early, %d bytes at its end cannot be read",
                self.path,
                self.cut_bytes,
            )

    def entries(self) -> Iterator[Entry]:
        """Everything, in the order in which it was written."""
        return self._read({**self._bytes(), **self._frames(), **self._estimates(), **self._notices()})

    def chunks(self) -> Iterator[Chunk]:
        """The bytes of the sources, with times to the nanosecond (`nanoseconds`)."""
        return self._read(self._bytes())

    def frames(self) -> Iterator[FrameEntry]:
        """The frames."""
        return self._read(self._frames())

    def estimates(self) -> Iterator[EstimateEntry]:
        """The estimates."""
        return self._read(self._estimates())

    def notices(self) -> Iterator[Notice]:
        """The notices."""
        return self._read(self._notices())

    def _bytes(self) -> dict[int, Reader[Chunk]]:
        def reader(source: int) -> Reader[Chunk]:
            return lambda message: Chunk(source, _seconds(message), message.data)

        found = {
            channel: _BYTES_TOPIC.fullmatch(topic)
            for channel, (topic, encoding) in self._channels.items()
            if encoding == _RAW
        }
        return {channel: reader(int(match[1])) for channel, match in found.items() if match}

    def _frames(self) -> dict[int, Reader[FrameEntry]]:
        form = FrameFormat(self.info.channels)
        return self._topic("/frame", lambda message: form.read(message.data))

    def _estimates(self) -> dict[int, Reader[EstimateEntry]]:
        form = EstimateFormat(self.info.estimates)
        return self._topic("/estimate", lambda message: form.read(message.data, _seconds(message)))

    def _notices(self) -> dict[int, Reader[Notice]]:
        return self._topic("/notice", lambda message: read_notice(message.data, _seconds(message)))

    def _topic(self, topic: str, reader: Reader[T]) -> dict[int, Reader[T]]:
        return {channel: reader for channel, found in self._channels.items() if found == (topic, _JSON)}

    def _open(self) -> BinaryIO:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"cannot open the session {self.path}: {error.strerror or error}") from error

    def _read(self, readers: dict[int, Reader[T]]) -> Iterator[T]:
        with self._open() as stream:
            for message in self._messages(stream):
                reader = readers.get(message.channel)
                if reader is None:
                    if message.channel not in self._channels:
                        self._miss("an entry of a channel that is not described")
                    continue
                try:
                    entry = reader(message)
                except RecordingError as error:
                    self._miss(f"an entry: {error}")
                else:
                    yield entry

    def _messages(self, stream: BinaryIO) -> Iterator[RawMessage]:
        for place in record_places(stream, self.size):
            if place.opcode in (_DATA_END, _FOOTER):
                return
            try:
                if place.opcode == _MESSAGE:
                    yield raw_message(content(stream, place))
                elif place.opcode == _CHUNK:
                    for opcode, data in chunk_records(content(stream, place)):
                        if opcode == _MESSAGE:
                            yield raw_message(data)
            except DamagedRecord as error:
                self._miss(str(error))

    def _miss(self, what: str) -> None:
        self.unreadable += 1
        if self.unreadable == 1:
            logger.warning("%s is damaged, something is missing: %s", self.path, what)

    def _survey(self, stream: BinaryIO) -> tuple[bool, int]:
        """Learn channels, metadata and config; whether the file is complete, and the bytes of a cut end."""
        stream.seek(0)
        magic = stream.read(len(MAGIC))
        if not MAGIC.startswith(magic):
            raise RecordingError(
                f"{self.path} is no MCAP file: a session of softfuse begins with MCAP's magic"
            )
        end, complete = min(len(MAGIC), self.size), False
        for place in record_places(stream, self.size):
            end = place.offset + place.length
            if place.opcode == _FOOTER:
                stream.seek(end)
                complete = stream.read(len(MAGIC)) == MAGIC
                end += len(MAGIC) if complete else 0
                break
            # The channels come before the first message, and again at the end of a complete file.
            if place.opcode != _CHUNK or not self._channels:
                self._learn_safely(stream, place)
        return complete, max(self.size - end, 0)

    def _learn_safely(self, stream: BinaryIO, place: RecordPlace) -> None:
        try:
            if place.opcode == _CHUNK:
                for opcode, data in chunk_records(content(stream, place)):
                    if opcode == _CHANNEL:
                        self._learn(opcode, bytes(data))
            elif place.opcode == _ATTACHMENT:
                self._learn(place.opcode, content(stream, place))
            elif place.opcode in (_HEADER, _CHANNEL, _METADATA):
                self._learn(place.opcode, content(stream, place, _LARGEST_HEAD))
        except DamagedRecord as error:
            logger.info("%s: %s", self.path, error)

    def _learn(self, opcode: int, data: bytes) -> None:
        from mcap.exceptions import McapError
        from mcap.records import Attachment, Channel, Header, Metadata

        try:
            if opcode == _HEADER:
                header = Header.read(data_stream(data))
                if header.profile != PROFILE:
                    raise RecordingError(
                        f"{self.path} is no session of softfuse but an MCAP file of profile "
                        f"{header.profile[:40]!r}, written by {header.library[:80]!r}"
                    )
            elif opcode == _CHANNEL:
                channel = Channel.read(data_stream(data))
                self._channels[channel.id] = (channel.topic, channel.message_encoding)
            elif opcode == _METADATA:
                metadata = Metadata.read(data_stream(data))
                self._metadata[metadata.name] = metadata.metadata
            else:
                attachment = Attachment.read(data_stream(data))
                if attachment.name == "config.toml":
                    self._config = attachment.data
        except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
            raise DamagedRecord("a record cannot be read") from error

    def _info(self) -> SessionInfo:
        about = self._metadata.get("softfuse")
        if about is None:
            if self.complete:
                raise RecordingError(f"{self.path} is no session of softfuse: it does not describe itself")
            return SessionInfo(version="")
        if about.get("format") != FORMAT:
            raise RecordingError(
                f"{self.path} is a session of format {about.get('format', '')[:40]!r}, written by softfuse "
                f"{about.get('version', '')[:40]!r}; this one reads format {FORMAT!r}: take a newer softfuse"
            )
        try:
            return SessionInfo(
                device=about.get("device", ""),
                command=about.get("command", ""),
                started=about.get("started", ""),
                channels=tuple(_strings(about.get("channels", "[]"))),
                estimates=_kinds(about.get("estimates", "{}")),
                sources=self._sources(about.get("sources", "0")),
                config=self._config,
                version=about.get("version", ""),
            )
        except RecordingError as error:
            raise RecordingError(f"{self.path} describes itself wrongly: {error}") from error

    def _sources(self, count: str) -> tuple[SourceInfo, ...]:
        if not (count.isascii() and count.isdigit() and len(count) < 5):
            raise RecordingError(f"{count[:40]!r} is no number of sources")
        found = (self._metadata.get(f"source/{k}", {}) for k in range(int(count)))
        return tuple(SourceInfo(about.get("url", ""), about.get("driver", "")) for about in found)


def _seconds(message: RawMessage) -> float:
    return message.log_ns / 1_000_000_000


def _strings(text: str) -> list[str]:
    found = parse_json(text.encode())
    if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
        raise RecordingError("its channels are no list of names")
    return found


def _kinds(text: str) -> dict[str, Kind]:
    found = parse_json(text.encode())
    if not isinstance(found, dict) or not all(kind in ("number", "string") for kind in found.values()):
        raise RecordingError("its columns of estimates are not what they must be")
    return found
