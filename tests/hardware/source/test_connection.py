"""Connections: what they hand out, how they come back, how they end, and what they say when they cannot."""

import errno
import os
import socket
import threading
import time
from itertools import pairwise

import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.source import connection as connection_module
from softfuse.hardware.source.connection import Connection, remedy
from softfuse.hardware.source.port import open_serial
from softfuse.hardware.stream import HostClock


def running(connection: Connection) -> bool:
    """Whether its thread is there."""
    return connection._thread is not None and connection._thread.is_alive()


@pytest.fixture
def connect(log):
    """Opens connections, and stops them at the end."""
    connections = []

    def connect(url, *, source=3, baud=115200, **settings):
        connection = Connection(
            source,
            str(url),
            lambda: open_serial(str(url), baud),
            log.on_chunk,
            log.on_notice,
            HostClock(),
            **settings,
        )
        connection.open()
        connections.append(connection)
        return connection

    yield connect
    for connection in connections:
        connection.stop()
        assert not running(connection)


def test_bytes_are_handed_out_in_order_with_the_time_at_which_they_came(plug, log, connect):
    before = time.time()
    connect(plug.path)
    stream = bytes(range(256)) * 40
    for k in range(0, len(stream), 512):
        plug.send(stream[k : k + 512])
    log.wait(lambda seen: len(seen.data) == len(stream))
    assert log.data == stream
    assert {chunk.source for chunk in log.chunks} == {3}
    times = [chunk.host_s for chunk in log.chunks]
    assert times == sorted(times) and before - 1.0 <= times[0] and times[-1] <= time.time() + 1.0
    assert log.texts == [f"info {plug.path}: open"]


def test_what_came_before_is_dropped(plug, log, connect):
    slave = os.open(plug.path, os.O_RDWR | os.O_NOCTTY)
    plug.send(b"stale")
    connect(plug.path)
    plug.send(b"fresh")
    log.wait(lambda seen: len(seen.data) >= 5)
    assert log.data == b"fresh"
    os.close(slave)


def test_a_port_is_back_within_a_second_of_its_return(plug, log, connect):
    connection = connect(plug.path)
    stop = threading.Event()

    def device() -> None:
        while not stop.wait(0.01):
            try:
                plug.send(b"x")
            except OSError:
                continue

    sender = threading.Thread(target=device)
    sender.start()
    delays = []
    for _ in range(3):
        count = len(log.chunks)
        log.wait(lambda seen, count=count: len(seen.chunks) > count + 2)
        plug.unplug()
        log.wait(lambda seen: "lost" in seen.notices[-1].text)
        assert not connection._connected.is_set() and not connection.send(b"nobody")
        # The device is away for longer than a poll, and the way back is measured to the first byte.
        time.sleep(0.3)
        count = len(log.chunks)
        returned = plug.plug()
        log.wait(lambda seen, count=count: any(chunk.data for chunk in seen.chunks[count:]))
        first = next(k for k in range(count, len(log.chunks)) if log.chunks[k].data)
        delays.append(log.chunk_times[first] - returned)
        assert log.chunks[first - 1].data == b""
    stop.set()
    sender.join()
    # An empty chunk says where the line was cut, and nothing else does.
    assert sum(chunk.data == b"" for chunk in log.chunks) == 3
    # A machine that is busy with other work may delay one of them.
    assert min(delays) < 0.5 and sorted(delays)[1] < 1.0, delays
    lost = [notice for notice in log.notices if "lost" in notice.text]
    back = [notice for notice in log.notices if "back after" in notice.text]
    assert [notice.level for notice in lost] == ["warning"] * 3 and len(back) == 3
    for gone, there in zip(lost, back, strict=True):
        told = float(there.text.split("back after ")[1].split(" s")[0])
        assert told == pytest.approx(there.host_s - gone.host_s, abs=0.2)
        assert told >= 0.25


def test_a_greeting_is_sent_part_by_part_and_again_after_a_silence_and_a_return(
    plug, log, connect, monkeypatch
):
    monkeypatch.setattr(connection_module, "SILENT_S", 1.0)
    connect(plug.path, greeting=(b"stop\n", b"rate\n", b"start\n"))
    whole = b"stop\nrate\nstart\n"
    assert plug.heard(len(whole)) == whole
    started = time.monotonic()
    assert plug.heard(len(whole)) == whole
    # 0.5 s of silence, and two pauses of 0.1 s
    assert time.monotonic() - started > 0.65
    plug.unplug()
    log.wait(lambda seen: "lost" in seen.notices[-1].text)
    plug.plug()
    assert plug.heard(len(whole)) == whole
    log.wait(lambda seen: any("nothing has come for" in text for text in seen.texts))
    plug.send(b"x")
    log.wait(lambda seen: "bytes again after" in seen.notices[-1].text)
    silences = [n for n in log.notices if "nothing has come for" in n.text]
    assert [n.level for n in silences] == ["warning"]


def test_a_device_that_sends_is_greeted_once(plug, log, connect):
    connect(plug.path, greeting=(b"start\n",))
    assert plug.heard(6) == b"start\n"
    for _ in range(70):
        plug.send(b"x")
        time.sleep(0.01)
    os.set_blocking(plug.master, False)
    with pytest.raises(BlockingIOError):
        os.read(plug.master, 100)


def test_other_threads_send_through_it_and_it_takes_its_leave(plug, log, connect):
    connection = connect(plug.path, farewell=b"bye")
    assert connection.send(b"ask")
    assert plug.heard(3) == b"ask"
    started = time.monotonic()
    connection.stop()
    assert time.monotonic() - started < 0.6
    assert plug.heard(3) == b"bye"
    count = len(log.chunks)
    plug.send(b"late")
    assert not running(connection) and len(log.chunks) == count


def test_a_device_that_takes_no_bytes_does_not_stop_the_reading(plug, log, connect):
    connection = connect(plug.path)
    for _ in range(16):
        connection.send(b"x" * 4096)
    plug.send(b"still here")
    log.wait(lambda seen: seen.data == b"still here")
    assert connection._connected.is_set()


def test_it_stops_while_it_waits_for_the_port(plug, log, connect):
    connection = connect(plug.path)
    plug.unplug()
    log.wait(lambda seen: "lost" in seen.notices[-1].text)
    started = time.monotonic()
    connection.stop()
    assert time.monotonic() - started < 0.6
    assert not running(connection)


def test_idle_connections_cost_next_to_nothing(plug, log, connect):
    connection = connect(plug.path)
    time.sleep(0.2)
    started = time.process_time()
    time.sleep(0.5)
    reading = time.process_time() - started
    plug.unplug()
    log.wait(lambda seen: "lost" in seen.notices[-1].text)
    started = time.process_time()
    time.sleep(0.5)
    waiting = time.process_time() - started
    assert running(connection)
    assert reading < 0.05 and waiting < 0.05


def test_bytes_come_over_tcp_and_it_connects_again(log, connect):
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"socket://127.0.0.1:{server.getsockname()[1]}"
        connect(address, greeting=(b"hello",))
        for k in range(2):
            device, _ = server.accept()
            # What comes before the port is open altogether is dropped.
            assert device.recv(5) == b"hello"
            stream = bytes([k]) * 100_000
            device.sendall(stream)
            log.wait(lambda seen, stream=stream: seen.data.endswith(stream))
            device.close()
    assert len(log.data) == 200_000
    # Bytes are read as they are there, not one by one.
    assert len(log.chunks) < 2000
    assert [chunk.data for chunk in log.chunks].count(b"") == 1


def test_what_is_written_to_loop_comes_back(log, connect):
    connection = connect("loop://")
    connection.send(b"hello")
    log.wait(lambda seen: seen.data == b"hello")


def test_two_programs_do_not_share_a_port(plug, log, connect):
    connect(plug.path)
    with pytest.raises(HardwareError, match="busy: close the other program"):
        connect(plug.path)


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("{tmp}/none", "{tmp}/none: there is no such port: plug the device in"),
        ("{tmp}", "{tmp}: "),
        ("socket://127.0.0.1:{closed}", "nobody listens there"),
        ("spy:///dev/null?file={tmp}/out", "is no port: give its name"),
        ("alt:///dev/null?class=PosixPollSerial", "is no port: give its name"),
        ("socket://", "socket://"),
        ("hwgrep://[", "hwgrep://["),
        ("rfc2217://127.0.0.1:{closed}", "nobody listens there"),
        ("", "is no port"),
        ("/dev/null", "/dev/null: is no serial port"),
    ],
)
def test_what_cannot_be_opened_is_told_in_a_line(tmp_path, connect, url, told):
    with socket.create_server(("127.0.0.1", 0)) as server:
        closed = server.getsockname()[1]
    with pytest.raises(HardwareError) as caught:
        connect(url.format(tmp=tmp_path, closed=closed))
    assert told.format(tmp=tmp_path, closed=closed) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_permissions_are_told_with_the_remedy():
    told = remedy("/dev/ttyUSB0", PermissionError(errno.EACCES, "Permission denied"))
    assert told.startswith("/dev/ttyUSB0: no permission") and "dialout" in told


def test_baud_rates_that_cannot_be_are_told(plug, connect):
    with pytest.raises(HardwareError, match="-5 baud"):
        connect(plug.path, baud=-5)


def test_times_never_go_back(plug, log, connect):
    connect(plug.path)
    for _ in range(50):
        plug.send(b"x")
        time.sleep(0.001)
    log.wait(lambda seen: len(seen.data) == 50)
    assert all(a.host_s <= b.host_s for a, b in pairwise(log.chunks))
