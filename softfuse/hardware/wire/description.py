"""What a device says about itself: its name and its channels (the payload of DESCRIPTION)."""

import struct
from dataclasses import dataclass

from fastcrc import crc16

from softfuse.errors import WireError
from softfuse.hardware.wire.channel import Channel, RawType, check_name

MOST_CHANNELS = 512
_CHANNEL = struct.Struct("<BffB")
_COUNT = struct.Struct("<H")


@dataclass(frozen=True)
class Description:
    """A device's name and channels; WireError for names used twice, no or too many channels."""

    name: str
    """Of the device, for people."""
    channels: tuple[Channel, ...]
    """In the order in which they are packed, 1 to 512."""

    def __post_init__(self) -> None:
        check_name(self.name, "device")
        if not 1 <= len(self.channels) <= MOST_CHANNELS:
            raise WireError(
                f"device {self.name!r} has {len(self.channels)} channels: 1 to {MOST_CHANNELS} are possible"
            )
        names = self.names
        if len(set(names)) < len(names):
            twice = next(name for k, name in enumerate(names) if name in names[:k])
            raise WireError(f"device {self.name!r} names two channels {twice!r}: rename one")

    @property
    def names(self) -> tuple[str, ...]:
        """The channels' names, in order."""
        return tuple(channel.name for channel in self.channels)

    def payload(self) -> bytes:
        """The bytes that describe this device on the wire."""
        parts = [_text(self.name), _COUNT.pack(len(self.channels))]
        for channel in self.channels:
            name = channel.name.encode()
            parts.append(_CHANNEL.pack(channel.type.value, channel.scale, channel.offset, len(name)) + name)
        return b"".join(parts)

    def layout(self) -> int:
        """The number that a sample names its layout with: the CRC of the payload."""
        return crc16.ibm_3740(self.payload())


def parse_description(payload: bytes) -> Description:
    """The description in a payload, all of it; WireError with the reason where it is not one."""
    name, at = _name(payload, 1, payload[0] if payload else 0)
    (count,) = _unpack(_COUNT, payload, at)
    at += _COUNT.size
    channels = []
    for _ in range(count):
        number, scale, offset, size = _unpack(_CHANNEL, payload, at)
        channel, at = _name(payload, at + _CHANNEL.size, size)
        try:
            kind = RawType(number)
        except ValueError as error:
            raise WireError(f"channel {channel!r} has the unknown type {number}") from error
        channels.append(Channel(channel, kind, scale, offset))
    if at != len(payload):
        raise WireError(f"the description has {len(payload) - at} bytes more than its channels")
    return Description(name, tuple(channels))


def _text(text: str) -> bytes:
    """A name with its length before it."""
    data = text.encode()
    return bytes([len(data)]) + data


def _unpack(form: struct.Struct, payload: bytes, at: int) -> tuple:
    if at + form.size > len(payload):
        raise WireError(f"the description ends after {len(payload)} bytes, within a channel")
    return form.unpack_from(payload, at)


def _name(payload: bytes, at: int, size: int) -> tuple[str, int]:
    """The name of so many bytes and where it ends."""
    if at + size > len(payload):
        raise WireError(f"the description ends after {len(payload)} bytes, within a name")
    try:
        return payload[at : at + size].decode(), at + size
    except UnicodeDecodeError as error:
        raise WireError(f"a name in the description is not UTF-8: {error.reason}") from error
