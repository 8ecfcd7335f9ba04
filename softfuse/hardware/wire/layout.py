"""A sample's content: which channels were read, and their raw values.

    value = scale * raw + offset

A channel that was not read and a float that is not finite are NaN. Compiled once per description, since it
runs for every sample.
"""

import struct

import numpy as np
from jaxtyping import Float

from softfuse.errors import WireError
from softfuse.hardware.wire.description import Description


class Layout:
    """The content of a description's samples, n channels."""

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
        self._lowest = np.array([channel.type.lowest for channel in channels])
        self._highest = np.array([channel.type.highest for channel in channels])
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
        raw = np.clip(raw, self._lowest, self._highest)
        numbers = [
            number if floating else round(number)
            for number, floating in zip(raw.tolist(), self._floating.tolist(), strict=True)
        ]
        return np.packbits(read, bitorder="little").tobytes() + self._raw.pack(*numbers)
