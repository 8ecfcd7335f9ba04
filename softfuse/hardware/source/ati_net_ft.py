"""ATI's Net F/T and Ethernet Axia: RDT records over UDP, one or several whole records in a datagram.

    request, 8 bytes:   u16 0x1234 | u16 command | u32 samples, 0 for without end
    record, 36 bytes:   u32 rdt_sequence | u32 ft_sequence | u32 status | i32 Fx Fy Fz Tx Ty Tz

all big endian, to and from UDP port 49152. Command 2 starts the stream, 0 stops it. rdt_sequence begins at 1
with each start, ft_sequence counts the sensor's own samples since power-on, both modulo 2^32.

    force = counts / counts per force,   torque = counts / counts per torque

whose constants the sensor's web page tells for the units that are set in it.

Sources: ATI manual 9610-05-Ethernet Axia-09, Sections 12.1 and 4.8; the same records, and command 2
as here, in Schunk's FTN-AXIA commissioning instructions 04.00. Of the status, bit 31 says in both that there
is an error, but the manuals of different models disagree about the other bits, and older ones set bit 31 for
bit 16 too (a monitor condition, no error). So values are NaN where bit 31 and any other but 16 are set, or 31
alone, and people are told the number.

The sensor's samples come at a rate that depends on model and settings (7000 per second, the manual says of
the Axia in Section 12.1.2, and up to 7912 elsewhere), so their number is a time only where the rate is given.
"""

import struct
from collections.abc import Mapping

import numpy as np

from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.robot.source import AtiNetFtSource

PORT = 49152
"""UDP port of the sensor."""
_REQUEST = struct.Struct(">HHI")
_RECORD = struct.Struct(">III6i")
_HEADER, _STOP, _START = 0x1234, 0, 2
_ERROR, _MONITOR = 1 << 31, 1 << 16
_WRAP = 2**32
_MOST_LATE = 10_000
"""Samples by which a datagram may come late."""


class AtiNetFt(AbstractDriver):
    """One Net F/T sensor."""

    def __init__(self, settings: AtiNetFtSource) -> None:
        super().__init__()
        per_force, per_torque = settings.counts_per_newton, settings.counts_per_newton_metre
        self._counts = np.array([per_force] * 3 + [per_torque] * 3)
        self._rate = settings.internal_rate
        self._names = settings.channels
        self._status = 0
        self._newest: int | None = None
        self._records = self._malformed = self._faulty = 0

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        """The readings in one datagram, which came at host_s [s]."""
        if not data or len(data) % _RECORD.size:
            self._malformed += 1
            return []
        return [self._reading(record, host_s) for record in _RECORD.iter_unpack(data)]

    def interrupted(self) -> None:
        """Nothing begins in one datagram and ends in the next."""

    @property
    def counts(self) -> Mapping[str, int]:
        """What became of the datagrams."""
        return {
            "samples": self._records,
            "samples in error": self._faulty,
            "malformed": self._malformed,
            "remarks left out": self._left_out,
        }

    def greeting(self) -> tuple[bytes, ...]:
        """Start the stream."""
        return (_REQUEST.pack(_HEADER, _START, 0),)

    def farewell(self) -> bytes:
        """Stop the stream, which the sensor would send to nobody without end."""
        return _REQUEST.pack(_HEADER, _STOP, 0)

    def _reading(self, record: tuple[int, ...], host_s: float) -> Reading:
        sequence, internal, status, *counts = record
        self._records += 1
        if status != self._status:
            self._status = status
            if status:
                told = f"the sensor's status is 0x{status:08x}: see Status Code in its manual"
                self._remark(host_s, "warning", told)
            else:
                self._remark(host_s, "info", "the sensor's status is healthy again")
        values = np.array(counts, dtype=np.float64) / self._counts
        if status & _ERROR and status != _ERROR | _MONITOR:
            self._faulty += 1
            values[:] = np.nan
        return Reading(0, sequence, self._time_us(internal), host_s, self._names, values)

    def _time_us(self, internal: int) -> int | None:
        """The sensor's time of its sample of this number, carried on over wraps."""
        if self._rate is None:
            return None
        newest = internal if self._newest is None else self._newest
        step = (internal - newest + _WRAP // 2) % _WRAP - _WRAP // 2
        carried = newest + step
        if step < -_MOST_LATE:
            # The sensor has restarted and begins anew.
            newest = carried = internal
        self._newest = max(newest, carried)
        return round(carried / self._rate * 1e6)
