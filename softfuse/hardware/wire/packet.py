"""Packets on the line: COBS(body crc) 0x00, made of bodies and found again in any stream of bytes."""

from dataclasses import dataclass

from cobs import cobs
from fastcrc import crc16

from softfuse.hardware.wire.message import LONGEST_BODY

CRC_SIZE = 2
LONGEST_PACKET = LONGEST_BODY + CRC_SIZE + (LONGEST_BODY + CRC_SIZE) // 254 + 1
"""Bytes of the longest packet, without the 0x00 at its end."""


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
