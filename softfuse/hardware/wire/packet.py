"""Packets on the line: COBS(body crc) 0x00, made of bodies and found again in any stream of bytes."""

from dataclasses import dataclass

from cobs import cobs
from fastcrc import crc16

from softfuse.hardware.wire.message import LONGEST_BODY

CRC_SIZE = 2
LONGEST_PACKET = LONGEST_BODY + CRC_SIZE + (LONGEST_BODY + CRC_SIZE) // 254 + 1
"""Bytes of the longest packet, without the 0x00 at its end."""


@dataclass(frozen=True)
class PacketCounts:
    """What became of the bytes: discarded or in packets, all but the 0x00 and a packet that has begun."""

    packets: int
    """Whole packets with the right CRC."""
    crc_failures: int
    """Packets with a wrong CRC, or too short to have one."""
    cobs_failures: int
    """Packets that are no COBS."""
    oversized: int
    """Packets longer than any can be."""
    bytes_discarded: int
    """Bytes of the packets of the last three kinds and of `discard_partial`, without the 0x00."""


def pack(body: bytes) -> bytes:
    """The packet that carries a body, with the 0x00 that ends it."""
    return cobs.encode(body + crc16.ibm_3740(body).to_bytes(CRC_SIZE, "little")) + b"\0"


class Unpacker:
    """Finds the bodies in a stream that comes in pieces of any size; holds at most one packet."""

    def __init__(self) -> None:
        self._partial = bytearray()
        self._too_long = False
        self._packets = 0
        self._crc_failures = 0
        self._cobs_failures = 0
        self._oversized = 0
        self._bytes_discarded = 0

    @property
    def counts(self) -> PacketCounts:
        """What has become of the bytes so far."""
        return PacketCounts(
            packets=self._packets,
            crc_failures=self._crc_failures,
            cobs_failures=self._cobs_failures,
            oversized=self._oversized,
            bytes_discarded=self._bytes_discarded,
        )

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
        self._bytes_discarded += len(self._partial)
        self._partial.clear()
        self._too_long = False

    def _extend(self, piece: bytes) -> None:
        if self._too_long:
            self._bytes_discarded += len(piece)
        elif len(self._partial) + len(piece) > LONGEST_PACKET:
            self._oversized += 1
            self._bytes_discarded += len(self._partial) + len(piece)
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
            self._cobs_failures += 1
            self._bytes_discarded += len(packet)
            return None
        body = data[:-CRC_SIZE]
        if len(data) < CRC_SIZE or crc16.ibm_3740(body) != int.from_bytes(data[-CRC_SIZE:], "little"):
            self._crc_failures += 1
            self._bytes_discarded += len(packet)
            return None
        self._packets += 1
        return body
