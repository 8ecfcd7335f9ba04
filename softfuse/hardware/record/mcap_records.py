"""The records of an MCAP file that may be cut, damaged or hostile, as far as they can be read.

    file = magic, records, magic;   record = opcode u8 | length u64 | content

(https://mcap.dev/spec; little endian). A length in the file is believed only up to what the file has left,
and what it leads to in memory is bounded by `LARGEST_RECORD`.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from mcap.data_stream import ReadDataStream

MAGIC = b"\x89MCAP0\r\n"
LARGEST_RECORD = 1 << 26
"""Bytes of the largest chunk, unpacked, or attachment that is read."""
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


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
    if len(data) < _MESSAGE.size:
        raise DamagedRecord("a message is shorter than its head")
    channel, _, log_ns, _ = _MESSAGE.unpack_from(data)
    return RawMessage(channel, log_ns, bytes(data[_MESSAGE.size :]))


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
