"""Six-axis force-torque sensors with a serial line: frames of one length that begin with one byte."""

import struct
from collections.abc import Callable, Mapping

import numpy as np
from fastcrc import crc16

from softfuse.hardware.source.driver import AbstractDriver, CounterTime, Reading
from softfuse.robot.source import BotaSource, RobotousRftSource

_BOTA_FRAME = struct.Struct("<BH6fIfH")
_INVALID = 0b1100
_MEANINGS = {
    0: "it skips measurements: set a longer filter",
    1: "the load is out of its range",
    2: "its values are not valid: unload it, and have it checked if that does not help",
    3: "its values are raw: switch the calibration on in its settings",
}
RATES = {10: 1, 20: 2, 50: 3, 100: 4, 200: 5, 333: 6, 500: 7, 1000: 8}
"""Samples per second that the sensor can send, and their numbers."""
_RFT_FIRST, _RFT_LAST = 0x55, 0xAA
_RESPONSE = 19
_ONCE, _START, _STOP, _SET_RATE = 10, 11, 12, 15


class FixedFrames:
    """Finds frames in a stream that comes in pieces of any size; holds less than one frame.

    The byte may stand within a frame too. So a candidate is a frame only if its check passes; if not, the
    search goes on with the byte after its first.
    """

    def __init__(self, start: int, size: int, check: Callable[[bytes], bool]) -> None:
        self._start = bytes([start])
        self._size = size
        self._check = check
        self._partial = bytearray()
        # Whether the byte before was the last of a frame, so that a frame must follow.
        self._in_step = False
        self.found = 0
        """Frames whose check passed."""
        self.failures = 0
        """How often no frame followed on a frame."""
        self.bytes_discarded = 0
        """Bytes that are in no frame."""

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that end in the next bytes of the stream, in order."""
        self._partial += data
        frames = []
        at = 0
        while True:
            begin = self._partial.find(self._start, at)
            if begin < 0:
                begin = len(self._partial)
            self._discard(begin - at)
            at = begin
            frame = bytes(self._partial[at : at + self._size])
            if len(frame) < self._size:
                break
            if self._check(frame):
                frames.append(frame)
                self._in_step = True
                at += self._size
            else:
                self._discard(1)
                at += 1
        del self._partial[:at]
        self.found += len(frames)
        return frames

    def interrupted(self) -> None:
        """Forget a frame that has begun, since the stream was cut."""
        self.bytes_discarded += len(self._partial)
        self._partial.clear()
        self._in_step = False

    def _discard(self, count: int) -> None:
        if count:
            self.bytes_discarded += count
            self.failures += self._in_step
            self._in_step = False


class BotaSerial(AbstractDriver):
    """Bota Systems sensors with a serial line (Rokubi, SensONE; RS-422 or USB), 460800 baud unless set
    otherwise.

        frame, 37 bytes:   0xAA | data | crc
        data, 34 bytes:    u16 status | f32 Fx Fy Fz Mx My Mz | u32 time | f32 temperature

    little endian, in N, N m, µs and °C; crc is the CRC-16/X-25 (0x906E for "123456789") of the data. Of the
    status, bit 0: the sensor is too slow for its settings; 1: out of range; 2: the values are not valid; 3:
    they are raw, without the calibration. Values with bits 2 or 3 are NaN.

    After power-on the sensor sends by itself, in this format unless it was set to text. Settings (filter and
    so the rate, format, baud rate) are kept in the sensor and are not changed here.

    Sources: the maker's driver rokubimini_serial (layout of the frame, bits of the status, CRC) and example
    code for MATLAB (positions, types), 2026. That the time is in µs is said in users' sources only. There is
    no number in a frame, so what goes missing is seen by the time only.
    """

    def __init__(self, settings: BotaSource) -> None:
        super().__init__()
        self._names = settings.channels
        self._frames = FixedFrames(0xAA, _BOTA_FRAME.size, _whole_bota)
        self._status = 0
        self._invalid = 0
        self._time = CounterTime()

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        return [self._reading(frame, host_s) for frame in self._frames.feed(data)]

    def interrupted(self) -> None:
        """Forget a frame that has begun."""
        self._frames.interrupted()

    @property
    def counts(self) -> Mapping[str, int]:
        return {
            "samples": self._frames.found,
            "samples not valid": self._invalid,
            "frame failures": self._frames.failures,
            "bytes discarded": self._frames.bytes_discarded,
            "remarks left out": self._left_out,
        }

    def _reading(self, frame: bytes, host_s: float) -> Reading:
        _, status, *wrench, time_us, _, _ = _BOTA_FRAME.unpack(frame)
        self._tell(status, host_s)
        values = np.array(wrench)
        values[~np.isfinite(values)] = np.nan
        if status & _INVALID:
            self._invalid += 1
            values[:] = np.nan
        return Reading(0, None, self._time.carried(time_us), host_s, self._names, values)

    def _tell(self, status: int, host_s: float) -> None:
        if status == self._status:
            return
        self._status = status
        told = [meaning for bit, meaning in _MEANINGS.items() if status >> bit & 1]
        if told:
            self._remark(host_s, "warning", f"the sensor says that {'; '.join(told)}")
        elif not status:
            self._remark(host_s, "info", "the sensor's status is healthy again")


def _whole_bota(frame: bytes) -> bool:
    return crc16.ibm_sdlc(frame[1:-2]) == int.from_bytes(frame[-2:], "little")


class RobotousRft(AbstractDriver):
    """Robotous RFT sensors with a serial line (RS-232, RS-422, USB), 115200 baud unless set otherwise.

        command, 11 bytes:    0x55 | 8 bytes of data | sum | 0xAA
        response, 19 bytes:   0x55 | 16 bytes of data | sum | 0xAA

    sum is that of the data, modulo 256. The first byte of the data is the command: 11 starts the output, 12
    stops it (and has no response), 15 sets its rate by the second byte (1: 10 Hz, 2: 20, 3: 50, 4: 100, 5:
    200, 6: 333, 7: 500, 8: 1000). Data of 10 (one sample) and 11 hold six i16, big endian, from byte 1 on, Fx
    Fy Fz Tx Ty Tz, and the overload status in byte 13, which is 0 where there is none.

        force = raw / 50,   torque = raw / 2000

    in N and N m for most models; the manual of the model tells its divisors.

    Sources: Robotous, RFT Series Installation and Operation Manual, revision 1.8, Sections 3.2 to 3.5
    (packets, commands, that the sensor is idle until started and takes settings only while stopped); the
    maker's sample source for UART, RFT_IF_PACKET (positions in the data, divisors). The numbers of the rates
    are from users' sources that agree with each other, not from the manual's own page, and which bit of the
    overload stands for which axis is not known here, nor what a response's result means: its number is told.
    The sensor sends no time and no number, so what goes missing between frames is seen by its rate only.
    """

    def __init__(self, settings: RobotousRftSource) -> None:
        super().__init__()
        per_force, per_torque = settings.counts_per_newton, settings.counts_per_newton_metre
        self._counts = np.array([per_force] * 3 + [per_torque] * 3)
        self._rate = settings.rate
        self._names = settings.channels
        self._frames = FixedFrames(_RFT_FIRST, _RESPONSE, _whole_rft)
        self._overload = 0
        self._samples = self._overloaded = 0

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        readings = []
        for frame in self._frames.feed(data):
            if frame[1] in (_ONCE, _START):
                readings.append(self._reading(frame, host_s))
            elif frame[1] == _SET_RATE:
                self._remark(
                    host_s, "info", f"the sensor was asked for its rate: result {frame[2]}, error {frame[3]}"
                )
        return readings

    def interrupted(self) -> None:
        """Forget a frame that has begun."""
        self._frames.interrupted()

    @property
    def counts(self) -> Mapping[str, int]:
        return {
            "samples": self._samples,
            "samples overloaded": self._overloaded,
            "responses": self._frames.found - self._samples,
            "frame failures": self._frames.failures,
            "bytes discarded": self._frames.bytes_discarded,
            "remarks left out": self._left_out,
        }

    def greeting(self) -> tuple[bytes, ...]:
        """Stop the output, since settings are not taken while it runs, set the rate, start it."""
        rate = () if self._rate is None else (_command(_SET_RATE, RATES[round(self._rate)]),)
        return (_command(_STOP), *rate, _command(_START))

    def farewell(self) -> bytes:
        """Stop the output."""
        return _command(_STOP)

    def _reading(self, frame: bytes, host_s: float) -> Reading:
        raw = np.frombuffer(frame, ">i2", count=6, offset=2)
        overload = frame[14]
        self._samples += 1
        self._overloaded += overload != 0
        if overload != self._overload:
            self._overload = overload
            if overload:
                self._remark(host_s, "warning", f"the sensor is overloaded (0x{overload:02x})")
            else:
                self._remark(host_s, "info", "the sensor is no longer overloaded")
        return Reading(0, None, None, host_s, self._names, raw.astype(np.float64) / self._counts)


def _whole_rft(frame: bytes) -> bool:
    return frame[-1] == _RFT_LAST and frame[-2] == sum(frame[1:-2]) % 256


def _command(number: int, parameter: int = 0) -> bytes:
    data = bytes([number, parameter, 0, 0, 0, 0, 0, 0])
    return bytes([_RFT_FIRST]) + data + bytes([sum(data) % 256, _RFT_LAST])
