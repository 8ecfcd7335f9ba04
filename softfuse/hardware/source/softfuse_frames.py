"""Devices that speak the binary protocol of softfuse/hardware/wire.

They describe themselves, so nothing has to be configured. A sample whose description has not come yet is
counted, and the host asks for the description.
"""

from collections.abc import Mapping

from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.hardware.wire.decoder import MOST_DEVICES, Decoder
from softfuse.hardware.wire.message import (
    EVERY_DEVICE,
    AskMessage,
    DescriptionMessage,
    Header,
    SampleMessage,
    TextMessage,
    encode,
    pack,
)

ASK_AGAIN_S = 0.5
"""After so long a device is asked again [s]."""


class SoftfuseFrames(AbstractDriver):
    """One line with one or several devices of the binary protocol."""

    def __init__(self) -> None:
        super().__init__()
        self._decoder = Decoder()
        # Names in the order in which the devices were heard of, as the decoder keeps its layouts.
        self._names: dict[int, tuple[str, ...]] = {}
        self._asked: dict[int, float] = {}
        self._requests = b""

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        readings = []
        for received in self._decoder.feed(data, host_s):
            match received.message:
                case SampleMessage(header=header) if received.values is not None:
                    number, time_us, names = header.sequence, header.time_us, self._names[header.device]
                    readings.append(Reading(header.device, number, time_us, host_s, names, received.values))
                case SampleMessage(header=header):
                    self._ask(header.device, host_s)
                case DescriptionMessage() as message:
                    self._learn(message, host_s)
                case TextMessage(header=header, text=text):
                    self._remark(host_s, "info", f"device {header.device}: {text}")
                case AskMessage():
                    pass  # an echo of the host's own
        return readings

    def interrupted(self) -> None:
        """Forget a packet that has begun; descriptions stay, a sample names the one that it follows."""
        self._decoder.discard_partial()

    @property
    def counts(self) -> Mapping[str, int]:
        counts = self._decoder.counts
        return {
            "samples": counts.samples - counts.undescribed,
            "samples not described": counts.undescribed,
            "CRC failures": counts.line.crc_failures,
            "COBS failures": counts.line.cobs_failures,
            "too long": counts.line.oversized,
            "malformed": counts.malformed,
            "of another version": counts.unknown_version,
            "of an unknown kind": counts.unknown_kind,
            "bytes discarded": counts.line.bytes_discarded,
            "remarks left out": self._left_out,
        }

    def greeting(self) -> tuple[bytes, ...]:
        """Ask every device for its description."""
        # The 0x00 ends what the line may have made up while it was plugged in.
        return (b"\0" + _question(EVERY_DEVICE),)

    def take_requests(self) -> bytes:
        """Questions to devices whose samples cannot be read."""
        requests, self._requests = self._requests, b""
        return requests

    def _ask(self, device: int, host_s: float) -> None:
        if abs(host_s - self._asked.get(device, -ASK_AGAIN_S)) < ASK_AGAIN_S:
            return
        if len(self._asked) >= MOST_DEVICES:
            self._asked.clear()
        self._asked[device] = host_s
        self._requests += _question(device)

    def _learn(self, message: DescriptionMessage, host_s: float) -> None:
        device, description = message.header.device, message.description
        before = self._names.pop(device, None)
        self._names[device] = description.names
        if before != description.names:
            self._remark(
                host_s,
                "info",
                f"device {device} is {description.name!r}, with {len(description.channels)} channels",
            )
        if len(self._names) > MOST_DEVICES:
            del self._names[next(iter(self._names))]


def _question(device: int) -> bytes:
    return pack(encode(AskMessage(Header(device, 0, 0))))
