"""Robotous RFT sensors with a serial line (RS-232, RS-422, USB), 115200 baud unless set otherwise.

    command, 11 bytes:    0x55 | 8 bytes of data | sum | 0xAA
    response, 19 bytes:   0x55 | 16 bytes of data | sum | 0xAA

sum is that of the data, modulo 256. The first byte of the data is the command: 11 starts the output, 12
stops it (and has no response), 15 sets its rate by the second byte (1: 10 Hz, 2: 20, 3: 50, 4: 100, 5: 200,
6: 333, 7: 500, 8: 1000). Data of 10 (one sample) and 11 hold six i16, big endian, from byte 1 on,
Fx Fy Fz Tx Ty Tz, and the overload status in byte 13, which is 0 where there is none.

    force = raw / 50,   torque = raw / 2000

in N and N m for most models; the manual of the model tells its divisors.

Sources: Robotous, RFT Series Installation and Operation Manual, revision 1.8, Sections 3.2 to 3.5 (packets,
commands, that the sensor is idle until started and takes settings only while stopped); the maker's sample
source for UART, RFT_IF_PACKET (positions in the data, divisors). The numbers of the rates are from users'
sources that agree with each other, not from the manual's own page, and which bit of the overload stands for
which axis is not known here, nor what a response's result means: its number is told. The sensor sends no
time and no number, so what goes missing between frames is seen by its rate only.
"""

from collections.abc import Mapping

import numpy as np

from softfuse.hardware.source.driver import AbstractDriver, Reading
from softfuse.hardware.source.fixed_frames import FixedFrames
from softfuse.robot.source import RobotousRftSource

RATES = {10: 1, 20: 2, 50: 3, 100: 4, 200: 5, 333: 6, 500: 7, 1000: 8}
"""Samples per second that the sensor can send, and their numbers."""
_FIRST, _LAST = 0x55, 0xAA
_RESPONSE = 19
_ONCE, _START, _STOP, _SET_RATE = 10, 11, 12, 15


class RobotousRft(AbstractDriver):
    """One RFT sensor."""

    def __init__(self, settings: RobotousRftSource) -> None:
        super().__init__()
        per_force, per_torque = settings.counts_per_newton, settings.counts_per_newton_metre
        self._counts = np.array([per_force] * 3 + [per_torque] * 3)
        self._rate = settings.rate
        self._names = settings.channels
        self._frames = FixedFrames(_FIRST, _RESPONSE, _whole)
        self._overload = 0
        self._samples = self._overloaded = 0

    def feed(self, data: bytes, host_s: float) -> list[Reading]:
        """The readings that end in the next bytes, which came at host_s [s]; in order."""
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
        """What became of the frames and of the bytes."""
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


def _whole(frame: bytes) -> bool:
    return frame[-1] == _LAST and frame[-2] == sum(frame[1:-2]) % 256


def _command(number: int, parameter: int = 0) -> bytes:
    data = bytes([number, parameter, 0, 0, 0, 0, 0, 0])
    return bytes([_FIRST]) + data + bytes([sum(data) % 256, _LAST])
