"""The drivers of Robotous' and Bota's sensors, against sensors made from the manuals' tables."""

import contextlib
import math
import os
import struct
import threading

import numpy as np
import pytest

from softfuse.hardware.source.connection import Connection
from softfuse.hardware.source.port import open_serial
from softfuse.hardware.source.serial_force_torque import BotaSerial, RobotousRft
from softfuse.hardware.stream import HostClock
from softfuse.robot.source import BotaSource, RobotousRftSource

NAN = math.nan


def rft(raw, overload=0, command=0x0B):
    """A response as in the manual's packet table: SOP, D1 to D16, checksum, EOP."""
    data = [command]
    for value in raw:
        data += [(value >> 8) & 0xFF, value & 0xFF]
    data += [overload, 0, 0]
    assert len(data) == 16
    return bytes([0x55, *data, sum(data) & 0xFF, 0xAA])


def crc_x25(data):
    """Bit by bit: polynomial 0x1021 reflected, start and final xor 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc ^ 0xFFFF


def bota(wrench, time_us=0, status=0):
    """A frame as in the maker's struct, packed."""
    data = struct.pack("<H", status) + struct.pack("<6f", *wrench) + struct.pack("<If", time_us, 31.5)
    assert len(data) == 34
    return b"\xaa" + data + struct.pack("<H", crc_x25(data))


RAW = (150, -100, 0x55AA, -2000, 400, -0x5600)
WRENCH = (1.5, -2.0, 30.0, -0.25, 0.5, -1.0)


def rft_driver(**settings):
    return RobotousRft(RobotousRftSource(driver="robotous-rft", url="COM1", **settings))


def bota_driver():
    return BotaSerial(BotaSource(driver="bota", url="COM1"))


SENSORS = {
    "rft": (rft_driver, lambda: rft(RAW), [3.0, -2.0, 0x55AA / 50, -1.0, 0.2, -0x5600 / 2000]),
    "bota": (bota_driver, lambda: bota(WRENCH), list(WRENCH)),
}


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("step", [1, 5, 1000])
def test_frames_become_forces_and_torques_however_they_are_cut(sensor, step):
    make, frame, expected = SENSORS[sensor]
    driver = make()
    stream = frame() * 20
    readings = [
        reading
        for k in range(0, len(stream), step)
        for reading in driver.feed(stream[k : k + step], float(k))
    ]
    assert len(readings) == 20
    for reading in readings:
        np.testing.assert_allclose(reading.values, expected, rtol=1e-7)
        assert reading.names == ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
        assert reading.sequence is None
    assert driver.counts["bytes discarded"] == driver.counts["frame failures"] == 0
    assert readings[0].host_s == (len(stream) // 20 - 1) // step * step


@pytest.mark.parametrize("sensor", SENSORS)
def test_damaged_frames_are_counted_and_the_next_ones_found(sensor):
    make, frame, expected = SENSORS[sensor]
    rng = np.random.default_rng(3)
    driver = make()
    for _ in range(300):
        damaged = bytearray(frame())
        damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
        readings = driver.feed(frame() + bytes(damaged) + frame() + frame(), 0.0)
        # The search may take bytes of the next frame for a beginning; it is over by the one after.
        assert 2 <= len(readings) <= 3
        for reading in readings:
            np.testing.assert_allclose(reading.values, expected, rtol=1e-7)
    assert 300 <= driver.counts["frame failures"] <= 400
    assert driver.counts["bytes discarded"] >= 300


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("false_starts", [1, 2, 3, 50])
def test_a_byte_that_looks_like_a_beginning_hides_no_frame(sensor, false_starts):
    make, frame, _ = SENSORS[sensor]
    driver = make()
    assert len(driver.feed(frame()[:1] * false_starts + frame() + frame(), 0.0)) == 2
    assert driver.counts["bytes discarded"] == false_starts


@pytest.mark.parametrize("sensor", SENSORS)
def test_noise_is_no_sample_and_does_not_pile_up(sensor):
    make, frame, _ = SENSORS[sensor]
    rng = np.random.default_rng(5)
    driver = make()
    readings = []
    for _ in range(200):
        readings += driver.feed(rng.integers(0, 256, 1000, dtype=np.uint8).tobytes(), 0.0)
    assert len(readings) <= 1
    assert driver.counts["bytes discarded"] > 199_000
    assert driver.feed(b"\0" * 40 + frame(), 0.0) != []


@pytest.mark.parametrize("sensor", SENSORS)
def test_half_a_frame_is_forgotten_at_an_interruption(sensor):
    make, frame, _ = SENSORS[sensor]
    driver = make()
    driver.feed(frame() + frame()[:10], 0.0)
    driver.interrupted()
    assert len(driver.feed(frame(), 0.0)) == 1
    assert driver.counts["frame failures"] == 0


def test_the_crc_is_that_of_the_catalogue():
    assert crc_x25(b"123456789") == 0x906E


def test_overloads_are_told_as_they_begin_and_end():
    driver = rft_driver()
    driver.feed(rft(RAW) + rft(RAW, 4) + rft(RAW, 4) + rft(RAW), 0.0)
    begun, ended = driver.take_notices()
    assert (begun.level, begun.text) == ("warning", "the sensor is overloaded (0x04)")
    assert ended.level == "info"
    assert driver.counts["samples overloaded"] == 2


def test_responses_that_are_no_samples_are_none():
    driver = rft_driver()
    name = [ord(sign) for sign in "RFT60-HA01"]
    response = bytes([1, *name, 0, 0, 0, 0, 0])
    assert driver.feed(b"\x55" + response + bytes([sum(response) % 256, 0xAA]), 0.0) == []
    assert driver.counts["responses"] == 1


@pytest.mark.parametrize(
    ("status", "valid", "told"),
    [
        (0b0001, True, "longer filter"),
        (0b0010, True, "out of its range"),
        (0b0100, False, "not valid"),
        (0b1010, False, "calibration on"),
    ],
)
def test_the_status_says_whether_values_can_be_believed(status, valid, told):
    driver = bota_driver()
    first, second, third = driver.feed(bota(WRENCH) + bota(WRENCH, 0, status) + bota(WRENCH), 0.0)
    assert np.isfinite(first.values).all() and np.isfinite(third.values).all()
    assert np.isfinite(second.values).all() == valid and np.isnan(second.values).all() == (not valid)
    warning, healthy = driver.take_notices()
    assert warning.level == "warning" and told in warning.text
    assert healthy.level == "info"


def test_values_that_are_no_numbers_are_missing():
    (reading,) = bota_driver().feed(bota((1.0, math.inf, NAN, 0.0, 0.0, 0.0)), 0.0)
    np.testing.assert_array_equal(reading.values, [1.0, NAN, NAN, 0.0, 0.0, 0.0])


def test_the_time_is_carried_on_over_wraps_and_begins_anew_after_a_restart():
    times = [2**32 - 5, 5, 1000, 10]
    readings = bota_driver().feed(b"".join(bota(WRENCH, time) for time in times), 0.0)
    assert [reading.device_time_us for reading in readings] == [2**32 - 5, 2**32 + 5, 2**32 + 1000, 10]


class Rft(threading.Thread):
    """A sensor that is idle until started and takes its rate only while stopped, as the manual says."""

    def __init__(self, plug) -> None:
        super().__init__(daemon=True)
        self.plug = plug
        self.rate = 200
        self.running = False
        self.log: list[tuple[int, int, bool]] = []
        self.ended = threading.Event()

    def run(self) -> None:
        partial = b""
        os.set_blocking(self.plug.master, False)
        while not self.ended.wait(1.0 / self.rate):
            with contextlib.suppress(OSError):
                partial += os.read(self.plug.master, 1000)
            while len(partial) >= 11:
                packet, partial = partial[:11], partial[11:]
                assert (packet[0], packet[10]) == (0x55, 0xAA) and packet[9] == sum(packet[1:9]) & 0xFF
                self.log.append((packet[1], packet[2], self.running))
                if packet[1] == 0x0B:
                    self.running = True
                elif packet[1] == 0x0C:
                    self.running = False
                elif packet[1] == 0x0F and not self.running:
                    self.rate = {4: 100, 7: 500}[packet[2]]
                    self.plug.send(rft((0,) * 6, command=0x0F))
            if self.running:
                self.plug.send(rft(RAW))


def test_an_rft_is_stopped_set_started_and_stopped_at_the_end(plug, log):
    sensor = Rft(plug)
    sensor.running = True
    driver = rft_driver(rate="100 Hz")
    connection = Connection(
        0,
        str(plug.path),
        lambda: open_serial(str(plug.path), 115200),
        log.on_chunk,
        log.on_notice,
        HostClock(),
        greeting=driver.greeting(),
        farewell=driver.farewell(),
    )
    connection.open()
    sensor.start()
    log.wait(lambda seen: len(seen.data) > 30 * 19 and sensor.log[-1][0] == 0x0B)
    connection.stop()
    for _ in range(200):
        if not sensor.running:
            break
        sensor.ended.wait(0.05)
    sensor.ended.set()
    sensor.join()
    commands = [(command, parameter) for command, parameter, _ in sensor.log]
    assert commands[:3] == [(0x0C, 0), (0x0F, 4), (0x0B, 0)] and commands[-1] == (0x0C, 0)
    assert [running for _, _, running in sensor.log[:3]] == [True, False, False]
    assert sensor.rate == 100 and not sensor.running
    readings = [reading for chunk in log.chunks for reading in driver.feed(chunk.data, chunk.host_s)]
    assert len(readings) > 20
    assert any("asked for its rate" in notice.text for notice in driver.take_notices())
