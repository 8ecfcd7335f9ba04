"""The driver of ATI's Net F/T, against a sensor made from the manual's tables."""

import socket
import threading

import numpy as np
import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.source import connection as connection_module
from softfuse.hardware.source.ati_net_ft import PORT, AtiNetFt
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.source.port import open_udp
from softfuse.hardware.stream import HostClock
from softfuse.robot.source import AtiNetFtSource


def record(rdt: int, ft: int, counts: tuple[int, ...], status: int = 0) -> bytes:
    """Nine numbers of 32 bits, high byte first."""
    words = (rdt, ft, status, *(count % 2**32 for count in counts))
    return b"".join(bytes([word >> 24, word >> 16 & 255, word >> 8 & 255, word & 255]) for word in words)


def driver_of(per_force: float = 1e6, per_torque: float = 1e6, **others) -> AtiNetFt:
    """The driver of a sensor with these counts per N and per N m."""
    settings = {"counts_per_newton": per_force, "counts_per_newton_metre": per_torque, **others}
    return AtiNetFt(AtiNetFtSource(driver="ati-net-ft", url="udp://127.0.0.1", **settings))


LOAD = (1_500_000, -2_000_000, 30_000_000, -4_000, 5_000, 2**31 - 1)


class Sensor(threading.Thread):
    """Sends records to whoever started it, until stopped, and forgets him when its power is cut."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.005)
        self.url = f"udp://127.0.0.1:{self.socket.getsockname()[1]}"
        self.heard: list[bytes] = []
        self.customer = None
        self.cut = threading.Event()
        self.ended = threading.Event()

    def run(self) -> None:
        rdt = 0
        while not self.ended.is_set():
            try:
                data, address = self.socket.recvfrom(1000)
            except TimeoutError:
                data = b""
            if self.cut.is_set():
                self.customer = None
                continue
            if data:
                self.heard.append(data)
                assert data[:2] == b"\x12\x34" and len(data) == 8
                self.customer = address if data[2:4] == b"\x00\x02" else None
                rdt = 0
            if self.customer:
                rdt += 1
                self.socket.sendto(record(rdt, 70 * rdt, LOAD), self.customer)
        self.socket.close()


@pytest.fixture
def sensor():
    sensor = Sensor()
    sensor.start()
    yield sensor
    sensor.ended.set()
    sensor.join()


def test_counts_become_forces_and_torques():
    (reading,) = driver_of(1e6, 1e3).feed(record(1, 70, LOAD), 5.0)
    np.testing.assert_allclose(reading.values, [1.5, -2.0, 30.0, -4.0, 5.0, 2147483.647], rtol=1e-15)
    assert reading.names == ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
    assert (reading.device, reading.sequence, reading.device_time_us, reading.host_s) == (0, 1, None, 5.0)


def test_a_datagram_may_hold_several_records_but_no_part_of_one():
    driver = driver_of()
    two = record(1, 1, LOAD) + record(2, 2, LOAD)
    assert [reading.sequence for reading in driver.feed(two, 0.0)] == [1, 2]
    assert driver.feed(two[:-1], 0.0) == driver.feed(b"", 0.0) == driver.feed(two + b"x", 0.0) == []
    # The rest of a datagram is not taken for the beginning of the next.
    assert [reading.sequence for reading in driver.feed(two, 0.0)] == [1, 2]
    assert driver.counts["malformed"] == 3 and driver.counts["samples"] == 4


def test_its_own_samples_are_a_time_where_their_rate_is_known_over_wraps_and_restarts():
    driver = driver_of(internal_rate="7 kHz")
    numbers = [2**32 - 70, 0, 70, 35, 140, 7, 14]
    readings = driver.feed(b"".join(record(1, number, LOAD) for number in numbers[:5]), 0.0)
    times = [reading.device_time_us for reading in readings]
    assert [(time - times[0]) / 1e4 for time in times] == pytest.approx([0, 1, 2, 1.5, 3], abs=1e-4)
    driver.feed(record(1, 50_000, LOAD), 0.0)
    (restarted,) = driver.feed(record(1, 7, LOAD), 0.0)
    assert restarted.device_time_us == 1000


@pytest.mark.parametrize(
    ("status", "valid"),
    [(0, True), (1 << 16, True), (0x8001_0000, True), (0xC000_0000, False), (0x8000_0000, False)],
)
def test_values_in_error_are_not_believed(status, valid):
    driver = driver_of()
    (reading,) = driver.feed(record(1, 1, LOAD, status), 0.0)
    assert np.isfinite(reading.values).all() == valid and np.isnan(reading.values).all() == (not valid)
    assert driver.counts["samples in error"] == (not valid)


def test_changes_of_the_status_are_told_once():
    driver = driver_of()
    driver.feed(b"".join(record(1, 1, LOAD, s) for s in (0, 0, 0x80000004, 0x80000004, 0)), 0.0)
    bad, good = driver.take_notices()
    assert bad.level == "warning" and "0x80000004" in bad.text
    assert good.level == "info" and "healthy" in good.text


def test_it_is_started_again_after_its_power_was_cut_and_stopped_at_the_end(sensor, log, monkeypatch):
    monkeypatch.setattr(connection_module, "SILENT_S", 0.3)
    driver = driver_of()
    connection = Connection(
        0,
        sensor.url,
        lambda: open_udp(sensor.url, PORT),
        log.on_chunk,
        log.on_notice,
        HostClock(),
        greeting=driver.greeting(),
        farewell=driver.farewell(),
    )
    connection.open()
    log.wait(lambda seen: len(seen.chunks) > 10)
    sensor.cut.set()
    log.wait(lambda seen: "nothing has come for" in seen.notices[-1].text)
    count = len(log.chunks)
    sensor.cut.clear()
    log.wait(lambda seen: len(seen.chunks) > count + 10)
    connection.stop()
    readings = [reading for chunk in log.chunks for reading in driver.feed(chunk.data, chunk.host_s)]
    assert len(readings) == len(log.chunks) and driver.counts["malformed"] == 0
    assert readings[count - 1].sequence > 1 and 1 in [reading.sequence for reading in readings[count - 1 :]]
    deadline = threading.Event()
    for _ in range(200):
        if sensor.customer is None:
            break
        deadline.wait(0.05)
    assert sensor.heard[0] == bytes.fromhex("1234 0002 00000000")
    assert sensor.heard[-1] == bytes.fromhex("1234 0000 00000000")


def test_datagrams_of_others_are_not_received(sensor, log):
    port = open_udp(sensor.url, PORT)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.sendto(record(1, 1, LOAD), port._way.getsockname())
    assert port.read() == b""
    stranger.close()
    port.close()


def test_a_computer_without_the_sensor_is_a_silence():
    nobody = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    nobody.bind(("127.0.0.1", 0))
    url = f"udp://127.0.0.1:{nobody.getsockname()[1]}"
    nobody.close()
    port = open_udp(url, PORT)
    port.write(b"start")
    for _ in range(3):
        assert port.read() == b""
    port.close()


@pytest.mark.parametrize(
    "url", ["udp://", "tcp://127.0.0.1", "udp://127.0.0.1:99999", "127.0.0.1", "udp://127.0.0.1/x"]
)
def test_addresses_that_cannot_be_are_told(url):
    with pytest.raises(HardwareError, match="is no address"):
        open_udp(url, PORT)
