"""From the bytes of a line to messages and values, with every byte accounted for.

    packets = messages handed out + malformed + unknown_version + unknown_kind

The host's time of a message is that of the piece of the stream in which its last byte came.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from softfuse.errors import WireError
from softfuse.hardware.wire.description import Description, Layout
from softfuse.hardware.wire.message import (
    KINDS,
    VERSION,
    DescriptionMessage,
    Message,
    PacketCounts,
    SampleMessage,
    Unpacker,
    decode,
)

MOST_DEVICES = 64
"""Descriptions that are remembered; the one heard of longest ago goes first."""


@dataclass(frozen=True, slots=True)
class Received:
    """A message and when it came."""

    host_s: float
    """The host's time at which its last byte came [s]."""
    message: Message
    values: Float[np.ndarray, " n"] | None
    """(n,) of a sample whose layout is known, in the units of the channels' names, NaN where not read."""


@dataclass
class DecoderCounts:
    """What became of the packets of a line."""

    line: PacketCounts
    """What became of its bytes."""
    samples: int = 0
    """Samples handed out, the undescribed ones included."""
    undescribed: int = 0
    """Samples handed out without values, since their layout is not known."""
    malformed: int = 0
    """Messages of a known kind that are not as they must be."""
    unknown_version: int = 0
    unknown_kind: int = 0


class Decoder:
    """The messages of one line, of one or several devices."""

    def __init__(self) -> None:
        self._unpacker = Unpacker()
        self._layouts: dict[int, Layout] = {}
        self.counts = DecoderCounts(self._unpacker.counts)
        """What has become of the packets so far."""

    @property
    def descriptions(self) -> dict[int, Description]:
        """The last description of each device heard of."""
        return {device: layout.description for device, layout in self._layouts.items()}

    def feed(self, data: bytes, host_s: float) -> list[Received]:
        """The messages that end in the next bytes of the line, which came at host_s [s]; in order.

        Nothing that the bytes are raises.
        """
        received = (self._received(body, host_s) for body in self._unpacker.feed(data))
        return [one for one in received if one is not None]

    def discard_partial(self) -> None:
        """Forget a packet that has begun, since the line was interrupted; descriptions stay."""
        self._unpacker.discard_partial()

    def _received(self, body: bytes, host_s: float) -> Received | None:
        if body[:1] != bytes([VERSION]) and body:
            self.counts.unknown_version += 1
            return None
        if len(body) > 1 and body[1] not in KINDS:
            self.counts.unknown_kind += 1
            return None
        try:
            message = decode(body)
            values = self._values(message) if isinstance(message, SampleMessage) else None
        except WireError:
            self.counts.malformed += 1
            return None
        if isinstance(message, SampleMessage):
            self.counts.samples += 1
            self.counts.undescribed += values is None
        elif isinstance(message, DescriptionMessage):
            self._learn(message)
        return Received(host_s, message, values)

    def _values(self, message: SampleMessage) -> Float[np.ndarray, " n"] | None:
        layout = self._layouts.get(message.header.device)
        if layout is None or layout.number != message.layout:
            return None
        return layout.values(message.content)

    def _learn(self, message: DescriptionMessage) -> None:
        device = message.header.device
        layout = self._layouts.pop(device, None)
        if layout is None or layout.description != message.description:
            layout = Layout(message.description)
        self._layouts[device] = layout
        if len(self._layouts) > MOST_DEVICES:
            del self._layouts[next(iter(self._layouts))]
