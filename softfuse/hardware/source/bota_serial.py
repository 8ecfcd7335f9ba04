"""Bota Systems sensors with a serial line (Rokubi, SensONE; RS-422 or USB), 460800 baud unless set otherwise.

    frame, 37 bytes:   0xAA | data | crc
    data, 34 bytes:    u16 status | f32 Fx Fy Fz Mx My Mz | u32 time | f32 temperature

little endian, in N, N m, µs and °C; crc is the CRC-16/X-25 (0x906E for "123456789") of the data. Of the
status, bit 0: the sensor is too slow for its settings; 1: out of range; 2: the values are not valid; 3: they
are raw, without the calibration. Values with bits 2 or 3 are NaN.

After power-on the sensor sends by itself, in this format unless it was set to text. Settings (filter and so
the rate, format, baud rate) are kept in the sensor and are not changed here.

Sources: the maker's driver rokubimini_serial (layout of the frame, bits of the status, CRC) and example code
for MATLAB (positions, types), 2026. That the time is in µs is said in users' sources only. There is no number
in a frame, so what goes missing is seen by the time only.
"""

import struct
from collections.abc import Mapping

import numpy as np
from fastcrc import crc16

from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.hardware.source.fixed_frames import FixedFrames
from softfuse.robot.source import BotaSource

_FIRST = 0xAA
_FRAME = struct.Struct("<BH6fIfH")
_INVALID = 0b1100
_MEANINGS = {
    0: "it skips measurements: set a longer filter",
    1: "the load is out of its range",
    2: "its values are not valid: unload it, and have it checked if that does not help",
    3: "its values are raw: switch the calibration on in its settings",
}
_WRAP = 2**32
_NEAR_WRAP = 60_000_000


class BotaSerial(AbstractDriver):
    """One Bota sensor."""

    def __init__(self, settings: BotaSource) -> None:
        super().__init__()
        self._names = settings.channels
        self._frames = FixedFrames(_FIRST, _FRAME.size, _whole)
        self._status = 0
        self._invalid = 0
        self._last = 0
        self._wraps = 0

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        """The readings that end in the next bytes, which came at host_s [s]; in order."""
        return [self._reading(frame, host_s) for frame in self._frames.feed(data)]

    def interrupted(self) -> None:
        """Forget a frame that has begun."""
        self._frames.interrupted()

    @property
    def counts(self) -> Mapping[str, int]:
        """What became of the frames and of the bytes."""
        return {
            "samples": self._frames.found,
            "samples not valid": self._invalid,
            "frame failures": self._frames.failures,
            "bytes discarded": self._frames.bytes_discarded,
            "remarks left out": self._left_out,
        }

    def _reading(self, frame: bytes, host_s: float) -> Reading:
        _, status, *wrench, time_us, _, _ = _FRAME.unpack(frame)
        self._tell(status, host_s)
        values = np.array(wrench)
        values[~np.isfinite(values)] = np.nan
        if status & _INVALID:
            self._invalid += 1
            values[:] = np.nan
        return Reading(0, None, self._carried(time_us), host_s, self._names, values)

    def _tell(self, status: int, host_s: float) -> None:
        if status == self._status:
            return
        self._status = status
        told = [meaning for bit, meaning in _MEANINGS.items() if status >> bit & 1]
        if told:
            self._remark(host_s, "warning", f"the sensor says that {'; '.join(told)}")
        elif not status:
            self._remark(host_s, "info", "the sensor's status is healthy again")

    def _carried(self, time_us: int) -> int:
        """The time, carried on over the wraps of 32 bits; a sensor that restarted begins anew."""
        if time_us < self._last:
            near = self._last > _WRAP - _NEAR_WRAP and time_us < _NEAR_WRAP
            self._wraps = self._wraps + 1 if near else 0
        self._last = time_us
        return time_us + self._wraps * _WRAP


def _whole(frame: bytes) -> bool:
    return crc16.ibm_sdlc(frame[1:-2]) == int.from_bytes(frame[-2:], "little")
