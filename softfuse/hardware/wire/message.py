"""Messages, their bodies (header and payload, without the CRC), and packets on the line: COBS(body crc) 0x00,
made of bodies and found again in any stream of bytes.
"""

import struct
from dataclasses import dataclass

from cobs import cobs
from fastcrc import crc16

from softfuse.errors import WireError
from softfuse.hardware.wire.description import Description, parse_description

VERSION = 1
DESCRIPTION, SAMPLE, TEXT, ASK = 1, 2, 3, 4
KINDS = (DESCRIPTION, SAMPLE, TEXT, ASK)
EVERY_DEVICE = 65535
"""The device of an ASK that all devices answer."""
LONGEST_BODY = 16384
"""Bytes of header and payload."""
_HEADER = struct.Struct("<BBHIQ")
_LAYOUT = struct.Struct("<H")
CRC_SIZE = 2
LONGEST_PACKET = LONGEST_BODY + CRC_SIZE + (LONGEST_BODY + CRC_SIZE) // 254 + 1
"""Bytes of the longest packet, without the 0x00 at its end."""


@dataclass(frozen=True, slots=True)
class Header:
    """Whose message, and when."""

    device: int
    """0 to 65534; 65535 is every device, in AskMessage."""
    sequence: int
    """Number of the sample, modulo 2^32; in other messages that of the next sample."""
    time_us: int
    """The device's time [µs], 64 bits."""


@dataclass(frozen=True, slots=True)
class DescriptionMessage:
    """A device describes itself."""

    header: Header
    description: Description


@dataclass(frozen=True, slots=True)
class SampleMessage:
    """All channels of a device at one time."""

    header: Header
    layout: int
    """Of the description that the content follows."""
    content: bytes
    """Presence and raw values; `Layout` reads it."""


@dataclass(frozen=True, slots=True)
class TextMessage:
    """A remark for the log; it is the device's, so escape it before it reaches a terminal."""

    header: Header
    text: str


@dataclass(frozen=True, slots=True)
class AskMessage:
    """The host asks for a description."""

    header: Header


Message = DescriptionMessage | SampleMessage | TextMessage | AskMessage


def encode(message: Message) -> bytes:
    """The body of a message; WireError where a number does not fit into its field or the body is too long."""
    match message:
        case DescriptionMessage(description=description):
            kind, payload = DESCRIPTION, description.payload()
        case SampleMessage(layout=layout, content=content):
            kind, payload = SAMPLE, _packed(_LAYOUT, layout) + content
        case TextMessage(text=text):
            kind, payload = TEXT, text.encode(errors="replace")
        case AskMessage():
            kind, payload = ASK, b""
    header = message.header
    body = _packed(_HEADER, VERSION, kind, header.device, header.sequence, header.time_us) + payload
    if len(body) > LONGEST_BODY:
        raise WireError(
            f"the message has {len(body)} bytes, {LONGEST_BODY} are possible: use shorter names or less text"
        )
    return body


def decode(body: bytes) -> Message:
    """The message in a body; WireError with the reason where there is none."""
    if len(body) < _HEADER.size:
        raise WireError(f"the body has {len(body)} bytes, a header has {_HEADER.size}")
    version, kind, device, sequence, time_us = _HEADER.unpack_from(body)
    if version != VERSION:
        raise WireError(f"the message is of version {version} of the protocol, this is version {VERSION}")
    header = Header(device, sequence, time_us)
    payload = body[_HEADER.size :]
    if kind == SAMPLE:
        if len(payload) < _LAYOUT.size:
            raise WireError(f"the payload of a sample has {len(payload)} bytes, a layout has {_LAYOUT.size}")
        return SampleMessage(header, _LAYOUT.unpack_from(payload)[0], payload[_LAYOUT.size :])
    if kind == DESCRIPTION:
        return DescriptionMessage(header, parse_description(payload))
    if kind == TEXT:
        try:
            return TextMessage(header, payload.decode())
        except UnicodeDecodeError as error:
            raise WireError(f"the text is not UTF-8: {error.reason}") from error
    if kind == ASK:
        if payload:
            raise WireError(f"a question has no payload, this one has {len(payload)} bytes")
        return AskMessage(header)
    raise WireError(f"the message has the unknown kind {kind}")


def _packed(form: struct.Struct, *numbers: int) -> bytes:
    try:
        return form.pack(*numbers)
    except struct.error as error:
        raise WireError(f"a number of the message does not fit into its field: {error}") from error


@dataclass
class PacketCounts:
    """What became of the bytes: discarded or in packets, all but the 0x00 and a packet that has begun."""

    packets: int = 0
    """Whole packets with the right CRC."""
    crc_failures: int = 0
    """Packets with a wrong CRC, or too short to have one."""
    cobs_failures: int = 0
    """Packets that are no COBS."""
    oversized: int = 0
    """Packets longer than any can be."""
    bytes_discarded: int = 0
    """Bytes of the packets of the last three kinds and of `discard_partial`, without the 0x00."""


def pack(body: bytes) -> bytes:
    """The packet that carries a body, with the 0x00 that ends it."""
    return cobs.encode(body + crc16.ibm_3740(body).to_bytes(CRC_SIZE, "little")) + b"\0"


class Unpacker:
    """Finds the bodies in a stream that comes in pieces of any size; holds at most one packet."""

    def __init__(self) -> None:
        self._partial = bytearray()
        self._too_long = False
        self.counts = PacketCounts()
        """What has become of the bytes so far."""

    def feed(self, data: bytes) -> list[bytes]:
        """The bodies that end in the next bytes of the stream, in order; never raises."""
        *ended, begun = data.split(b"\0")
        bodies = []
        for piece in ended:
            body = self._end(piece)
            if body is not None:
                bodies.append(body)
        self._extend(begun)
        return bodies

    def discard_partial(self) -> None:
        """Forget a packet that has begun, for instance since the line was interrupted."""
        self.counts.bytes_discarded += len(self._partial)
        self._partial.clear()
        self._too_long = False

    def _extend(self, piece: bytes) -> None:
        if self._too_long:
            self.counts.bytes_discarded += len(piece)
        elif len(self._partial) + len(piece) > LONGEST_PACKET:
            self.counts.oversized += 1
            self.counts.bytes_discarded += len(self._partial) + len(piece)
            self._partial.clear()
            self._too_long = True
        else:
            self._partial += piece

    def _end(self, piece: bytes) -> bytes | None:
        """The body of the packet that this piece completes, or None."""
        self._extend(piece)
        if self._too_long:
            self._too_long = False
            return None
        if not self._partial:
            return None
        packet = bytes(self._partial)
        self._partial.clear()
        try:
            data = cobs.decode(packet)
        except cobs.DecodeError:
            self.counts.cobs_failures += 1
            self.counts.bytes_discarded += len(packet)
            return None
        body = data[:-CRC_SIZE]
        if len(data) < CRC_SIZE or crc16.ibm_3740(body) != int.from_bytes(data[-CRC_SIZE:], "little"):
            self.counts.crc_failures += 1
            self.counts.bytes_discarded += len(packet)
            return None
        self.counts.packets += 1
        return body
