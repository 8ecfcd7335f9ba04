"""One channel of a device: its name, how its raw value is packed, and what the raw value means.

    value = scale * raw + offset

in the unit that the name ends with. Scale and offset travel as 32 bit floats.
"""

import math
import struct
from dataclasses import dataclass
from enum import Enum

from softfuse.errors import WireError

LONGEST_NAME = 255
"""Longest name of a channel or a device [bytes of UTF-8]."""
RESERVED_NAME = "time_s"
"""The column of a recording that the host fills."""


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
    def lowest(self) -> float:
        """The lowest raw value that is finite."""
        if self.floating:
            return -self.highest
        return -(2.0 ** (8 * self.size - 1)) if self.name[0] == "I" else 0.0

    @property
    def highest(self) -> float:
        """The highest raw value that is finite."""
        if self is RawType.F32:
            return (2.0 - 2.0**-23) * 2.0**127
        if self is RawType.F64:
            return (2.0 - 2.0**-52) * 2.0**1023
        return 2.0 ** (8 * self.size - (self.name[0] == "I")) - 1.0


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
