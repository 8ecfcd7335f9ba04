"""Messages and their bodies (header and payload, without the CRC)."""

import struct
from dataclasses import dataclass

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
