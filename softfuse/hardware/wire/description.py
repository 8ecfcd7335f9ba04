"""What a device says about itself: its name and its channels (the payload of DESCRIPTION), and how the
contents of its samples are packed.

    value = scale * raw + offset

in the unit that a channel's name ends with. Scale and offset travel as 32 bit floats. A channel that was not
read and a float that is not finite are NaN.
"""

import math
import struct
from dataclasses import dataclass
from enum import Enum

import numpy as np
from fastcrc import crc16
from jaxtyping import Float

from softfuse.errors import WireError

LONGEST_NAME = 255
"""Longest name of a channel or a device [bytes of UTF-8]."""
RESERVED_NAME = "time_s"
"""The column of a recording that the host fills."""
MOST_CHANNELS = 512
_CHANNEL = struct.Struct("<BffB")
_COUNT = struct.Struct("<H")


class RawType(Enum):
    """How a raw value is packed; the value is its number on the wire."""

    U8 = 1
    I8 = 2
    U16 = 3
    I16 = 4
    U32 = 5
    I32 = 6
    F32 = 7
    F64 = 8

    @property
    def code(self) -> str:
        """Its letter in Python's struct formats."""
        return "BbHhIifd"[self.value - 1]

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return struct.calcsize("<" + self.code)

    @property
    def floating(self) -> bool:
        """Whether it is an IEEE 754 number rather than an integer."""
        return self in (RawType.F32, RawType.F64)

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and the highest raw value that is finite."""
        limits = np.finfo(self.code) if self.floating else np.iinfo(self.code)
        return float(limits.min), float(limits.max)


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel; WireError for a name or number that the protocol does not allow."""

    name: str
    """Column of a recording, ends with the unit of the value; without one it is counts."""
    type: RawType
    """How the raw value is packed."""
    scale: float
    """Value per raw value, rounded to 32 bits here as on the wire; not 0."""
    offset: float
    """Value of the raw value 0, rounded to 32 bits as well."""

    def __post_init__(self) -> None:
        check_name(self.name, "channel")
        if self.name == RESERVED_NAME:
            raise WireError(f"a channel cannot be named {RESERVED_NAME!r}, the host's own column: rename it")
        object.__setattr__(self, "scale", self._single(self.scale, "scale"))
        object.__setattr__(self, "offset", self._single(self.offset, "offset"))
        if self.scale == 0.0:
            raise WireError(f"channel {self.name!r} has the scale 0 in 32 bits: give it another")

    def _single(self, number: float, what: str) -> float:
        """The number rounded to 32 bits."""
        try:
            rounded = struct.unpack("<f", struct.pack("<f", number))[0]
        except OverflowError:
            rounded = math.inf
        if not math.isfinite(rounded):
            raise WireError(f"the {what} {number!r} of channel {self.name!r} is not a finite 32 bit float")
        return rounded


def check_name(name: str, owner: str) -> None:
    """WireError unless the name can stand in the header of a CSV file and in one line on a screen."""
    try:
        size = len(name.encode())
    except UnicodeEncodeError as error:
        raise WireError(f"the {owner}'s name {name!r} cannot be written in UTF-8") from error
    if not 1 <= size <= LONGEST_NAME:
        raise WireError(f"a {owner}'s name has 1 to {LONGEST_NAME} bytes, this one has {size}: {name[:40]!r}")
    if not name.isprintable() or any(sign in name for sign in ",;\"'") or name.strip() != name:
        raise WireError(
            f"the {owner}'s name {name!r} must be printable, without commas, semicolons and quotes, "
            "and without spaces at its ends"
        )


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
        own = self.name.encode()
        parts = [bytes([len(own)]) + own + _COUNT.pack(len(self.channels))]
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


class Layout:
    """The content of a description's samples, n channels: which were read, and their raw values.

    Compiled once per description, since it runs for every sample.
    """

    def __init__(self, description: Description) -> None:
        channels = description.channels
        self.description = description
        """Whose samples these are."""
        self.number = description.layout()
        """What a sample names its layout with."""
        self._count = len(channels)
        self._presence_size = (self._count + 7) // 8
        self._everything = ((1 << self._count) - 1).to_bytes(self._presence_size, "little")
        self._raw = struct.Struct("<" + "".join(channel.type.code for channel in channels))
        self.size = self._presence_size + self._raw.size
        """Bytes of a content."""
        self._scale = np.array([channel.scale for channel in channels])
        self._offset = np.array([channel.offset for channel in channels])
        self._range = np.array([channel.type.range for channel in channels]).T
        self._floating = np.array([channel.type.floating for channel in channels])
        self._any_floating = bool(self._floating.any())

    def values(self, content: bytes) -> Float[np.ndarray, " n"]:
        """The values (n,) in the units of the channels' names, NaN where not read.

        WireError where the content has another size or says that a channel beyond the last was read.
        """
        if len(content) != self.size:
            raise WireError(
                f"a sample of {self.description.name!r} holds {self.size} bytes, this one {len(content)}"
            )
        values = np.array(self._raw.unpack_from(content, self._presence_size), dtype=np.float64)
        if self._any_floating:
            # Products may overflow and NaNs may signal; both become NaN, neither may warn.
            with np.errstate(all="ignore"):
                values *= self._scale
                values += self._offset
            values[~np.isfinite(values)] = np.nan
        else:
            values *= self._scale
            values += self._offset
        presence = content[: self._presence_size]
        if presence != self._everything:
            if presence[-1] & ~self._everything[-1]:
                raise WireError(
                    f"a sample of {self.description.name!r} has read more than {self._count} channels"
                )
            bits = np.unpackbits(np.frombuffer(presence, np.uint8), bitorder="little")
            values[bits[: self._count] == 0] = np.nan
        return values

    def content(self, values: Float[np.ndarray, " n"]) -> bytes:
        """The content that says the values (n,), in the units of the channels' names.

        NaN is a channel that was not read. Others are rounded to the nearest raw value and clipped to the
        range of the type, as an analog-to-digital converter does.
        """
        values = np.asarray(values, dtype=np.float64)
        if values.shape != (self._count,):
            raise WireError(
                f"{self.description.name!r} has {self._count} channels, the values have shape {values.shape}"
            )
        read = ~np.isnan(values)
        with np.errstate(over="ignore"):
            raw = (np.where(read, values, self._offset) - self._offset) / self._scale
        raw = np.clip(raw, *self._range)
        numbers = [
            number if floating else round(number)
            for number, floating in zip(raw.tolist(), self._floating.tolist(), strict=True)
        ]
        return np.packbits(read, bitorder="little").tobytes() + self._raw.pack(*numbers)
