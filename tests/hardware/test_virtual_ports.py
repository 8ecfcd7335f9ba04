"""Virtual boards on real ports of the operating system: a pseudo-terminal and a TCP port on loopback."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import serial
from served import Served

from softfuse.errors import HardwareError
from softfuse.hardware.virtual.board import BoardClock, VirtualBoard
from softfuse.hardware.virtual.faults import FaultyLine, LineFaults, Outages
from softfuse.hardware.virtual.ports import AbstractOutlet, PseudoTerminal, TcpPort
from softfuse.hardware.virtual.serving import (
    Pace,
    VirtualDevice,
    VirtualPort,
    as_fast_as_read,
    in_real_time,
)
from softfuse.hardware.wire.decoder import Decoder
from softfuse.hardware.wire.description import Channel, Description, RawType
from softfuse.hardware.wire.message import EVERY_DEVICE, AskMessage, Header, SampleMessage, encode, pack
from softfuse.hardware.wire.sequence import SequenceWatch

ASK = pack(encode(AskMessage(Header(EVERY_DEVICE, 0, 0))))
OUTLETS = {"terminal": PseudoTerminal, "tcp": lambda: TcpPort(0)}

Serve = Callable[..., Served]


def read(time_s: np.ndarray) -> np.ndarray:
    """Counts that tell the time."""
    return np.stack([np.rint(1000 * time_s) % 60000] * 20, axis=1)


def port_of(*outlets: AbstractOutlet, number: int = 1, rate: float = 100.0) -> VirtualPort:
    channels = tuple(Channel(f"row{k}", RawType.U16, 1.0, 0.0) for k in range(20))
    board = VirtualBoard(number, Description(f"board {number}", channels), read, BoardClock(rate))
    return VirtualPort(board, FaultyLine(LineFaults(), (0,)), outlets)


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Serves ports, and stops in the end."""
    served: list[Served] = []

    def start(*ports: VirtualPort, pace: Pace = in_real_time, outages: Outages | None = None) -> Served:
        device = Served(ports, pace, outages=outages)
        served.append(device)
        device.start()
        return device

    yield start
    for device in served:
        device.stop()


@pytest.fixture(params=OUTLETS)
def outlet(request: pytest.FixtureRequest) -> AbstractOutlet:
    return OUTLETS[request.param]()


def read_for(stream: serial.SerialBase, seconds: float, decoder: Decoder) -> list[int]:
    """Sequence numbers that came within a time."""
    stream.timeout = 0.02
    numbers: list[int] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for one in decoder.feed(stream.read(4096), 0.0):
            if isinstance(one.message, SampleMessage):
                numbers.append(one.message.header.sequence)
    return numbers


def until(condition: Callable[[], bool], seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


def test_samples_come_in_time_and_without_a_gap(serve: Serve, outlet: AbstractOutlet) -> None:
    port = port_of(outlet)
    start = time.monotonic()
    serve(port)
    decoder = Decoder()
    with serial.serial_for_url(port.urls[0], timeout=0.1) as stream:
        stream.write(ASK)
        assert until(lambda: port.listened)
        numbers = read_for(stream, 2.0, decoder)
        elapsed = time.monotonic() - start
    assert (np.diff(numbers) == 1).all() and len(numbers) > 100
    # Counted from the start: what is late on a busy machine is caught up with.
    assert numbers[-1] == pytest.approx(100 * elapsed, abs=40)
    assert decoder.counts.line.bytes_discarded == decoder.counts.malformed == 0
    # At most what came before the answer.
    assert port.board.counts.answers == 1 and decoder.counts.undescribed <= 40


def test_the_mean_rate_does_not_drift_however_late_it_wakes_up() -> None:
    port, pace, stop = port_of(PseudoTerminal(), rate=997.0), in_real_time, threading.Event()
    stop.set()
    port.board.switch_on(0.0)
    for elapsed in np.cumsum(np.tile([0.0, 0.0003, 0.02, 0.15, 0.001], 200)).tolist():
        pace([port], elapsed, stop)
        assert port.board.next_s - 1.0 / 997.0 <= elapsed < port.board.next_s
    counts = port.board.counts
    assert counts.samples == int(997.0 * elapsed) + 1
    # Nobody has listened.
    assert port.sent == 0 and port.unheard == counts.samples + counts.descriptions - 1


def test_as_fast_as_it_is_read_nothing_is_lost(serve: Serve, outlet: AbstractOutlet) -> None:
    port = port_of(outlet)
    device = serve(port, pace=as_fast_as_read)
    decoder, watch = Decoder(), SequenceWatch()
    time.sleep(0.1)
    assert port.board.counts.samples == 0
    with serial.serial_for_url(port.urls[0], timeout=0.1) as stream:
        stream.write(ASK)
        start, pauses = time.monotonic(), 3
        while decoder.counts.samples < 6000 and time.monotonic() < start + 40:
            for one in decoder.feed(stream.read(512), 0.0):
                if isinstance(one.message, SampleMessage):
                    watch.place(one.message.header.sequence, one.message.header.time_us)
            if pauses and decoder.counts.samples > 1500 * (4 - pauses):
                # It waits for a reader that is away.
                pauses -= 1
                time.sleep(0.2)
    assert watch.counts.lost == watch.counts.duplicated == watch.counts.restarted == watch.counts.late == 0
    assert decoder.counts.line.bytes_discarded == decoder.counts.malformed == 0
    device.stop()
    assert decoder.counts.samples >= 6000


def test_a_slow_reader_loses_whole_packets_only(serve: Serve, outlet: AbstractOutlet) -> None:
    port = port_of(outlet, rate=4000.0)
    serve(port)
    decoder, watch = Decoder(), SequenceWatch()
    with serial.serial_for_url(port.urls[0], timeout=0.05) as stream:
        assert until(lambda: port.listened)
        stream.write(ASK)
        before = port.unheard
        assert until(lambda: port.unheard > before + 500, 20)
        end = time.monotonic() + 10
        while watch.counts.lost == 0 and time.monotonic() < end:
            for one in decoder.feed(stream.read(4096), 0.0):
                if isinstance(one.message, SampleMessage):
                    watch.place(one.message.header.sequence, one.message.header.time_us)
    assert watch.counts.lost > 0 and decoder.counts.line.bytes_discarded == 0


def test_unplugged_is_gone_and_back_with_a_gap(serve: Serve, tmp_path: Path) -> None:
    link = tmp_path / "device"
    port = port_of(PseudoTerminal(link))
    serve(port, outages=Outages(for_s=0.5, every_s=1.2))
    decoder, watch = Decoder(), SequenceWatch()

    def follow(stream: serial.SerialBase) -> None:
        with pytest.raises((serial.SerialException, OSError)):
            while True:
                for one in decoder.feed(stream.read(256), 0.0):
                    if isinstance(one.message, SampleMessage):
                        watch.place(one.message.header.sequence, one.message.header.time_us)

    with serial.serial_for_url(str(link), timeout=0.5) as stream:
        follow(stream)
    gone = time.monotonic()
    assert until(lambda: not link.is_symlink())
    decoder.discard_partial()
    assert until(link.is_symlink, 2.0)
    assert time.monotonic() - gone < 1.5
    with serial.serial_for_url(str(link), timeout=0.5) as stream:
        follow(stream)
    counts = watch.counts
    # Half a second, and what it took to open it again.
    assert 45 < counts.lost < 120 and counts.fresh > 60
    assert counts.restarted == counts.late == counts.duplicated == 0
    assert decoder.counts.line.crc_failures <= 1 and port.outages == 2


def test_tcp_is_unplugged_too_and_keeps_its_port(serve: Serve) -> None:
    port = port_of(TcpPort(0))
    serve(port, outages=Outages(for_s=0.3, every_s=0.8))
    url = port.urls[0]
    host, number = url.removeprefix("socket://").split(":")
    with socket.create_connection((host, int(number)), timeout=2) as stream:
        while stream.recv(4096):
            pass
    assert port.urls[0] == url
    assert until(lambda: port.plugged, 2.0)
    with serial.serial_for_url(url, timeout=0.5) as stream:
        assert stream.read(10)


def test_power_that_comes_back_starts_the_board_anew(serve: Serve) -> None:
    port = port_of(PseudoTerminal())
    serve(port, outages=Outages(for_s=0.2, every_s=1.5, powers=True))
    assert until(lambda: port.board.counts.power_ons == 2)
    with serial.serial_for_url(port.urls[0], timeout=0.1) as stream:
        stream.write(ASK)
        numbers = read_for(stream, 0.3, Decoder())
    # Running on it would be at 150.
    assert numbers and max(numbers) < 120


def test_the_next_listener_does_not_get_what_the_last_left_unread(serve: Serve) -> None:
    port = port_of(PseudoTerminal())
    serve(port)
    with serial.serial_for_url(port.urls[0]) as stream:
        assert until(lambda: stream.in_waiting > 500)
    assert until(lambda: not port.listened)
    time.sleep(0.3)
    name = os.open(port.urls[0], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    decoder = Decoder()
    with os.fdopen(name, "rb", buffering=0) as stream:
        end = time.monotonic() + 0.3
        numbers = []
        while time.monotonic() < end:
            for one in decoder.feed(stream.read(4096) or b"", 0.0):
                if isinstance(one.message, SampleMessage):
                    numbers.append(one.message.header.sequence)
            time.sleep(0.01)
    assert numbers[0] > 30 and (np.diff(numbers) == 1).all()


def test_nothing_is_echoed(serve: Serve) -> None:
    port = port_of(PseudoTerminal())
    serve(port)
    # Opened without settings of its own: what the host sends must not come back, nor what it gets go out.
    stream = os.open(port.urls[0], os.O_RDWR | os.O_NOCTTY)
    os.write(stream, b"\x03hello\r\n\0" + ASK)
    decoder = Decoder()
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        decoder.feed(os.read(stream, 4096), 0.0)
    os.close(stream)
    assert decoder.counts.samples > 20 and decoder.counts.line.bytes_discarded == 0
    assert port.board.counts.answers == 1


def test_two_boards_go_on_in_step(serve: Serve) -> None:
    ports = [port_of(PseudoTerminal(), number=k) for k in (1, 2)]
    serve(*ports, pace=as_fast_as_read)
    decoders = [Decoder(), Decoder()]
    streams = [serial.serial_for_url(port.urls[0], timeout=0.05) for port in ports]

    def drain(k: int) -> None:
        while decoders[k].counts.samples < 3000:
            decoders[k].feed(streams[k].read(1024), 0.0)

    threads = [threading.Thread(target=drain, args=(k,)) for k in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert [decoder.counts.samples >= 3000 for decoder in decoders] == [True, True]
    one, two = (port.board.counts.samples for port in ports)
    assert abs(one - two) <= 32
    for stream in streams:
        stream.close()


def test_a_link_does_not_replace_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    port = port_of(PseudoTerminal(tmp_path / "mine"))
    with pytest.raises(HardwareError, match="not a link"):
        Served([port]).start()
    assert (tmp_path / "mine").read_text() == "precious"


def test_a_link_goes_with_the_device_and_replaces_one_that_was_left(serve: Serve, tmp_path: Path) -> None:
    link = tmp_path / "device"
    link.symlink_to(tmp_path / "left over")
    device = serve(port_of(PseudoTerminal(link)))
    assert link.exists() and os.readlink(link).startswith("/dev/")
    device.stop()
    assert not link.is_symlink()


def test_a_taken_port_is_told(serve: Serve) -> None:
    first = port_of(TcpPort(0))
    serve(first)
    number = int(first.urls[0].split(":")[-1])
    with pytest.raises(HardwareError, match=f"port {number}"):
        Served([port_of(PseudoTerminal(), TcpPort(number))]).start()


def test_it_listens_on_loopback_only(serve: Serve) -> None:
    port = port_of(TcpPort(0))
    serve(port)
    number = int(port.urls[0].split(":")[-1])
    state = Path("/proc/net/tcp").read_text().splitlines()[1:]
    listening = {line.split()[1] for line in state if line.split()[3] == "0A"}
    assert {at for at in listening if at.endswith(f":{number:04X}")} == {f"0100007F:{number:04X}"}


def test_it_ends_by_itself() -> None:
    port = port_of(PseudoTerminal())
    start = time.monotonic()
    VirtualDevice([port], in_real_time).run(0.3)
    assert time.monotonic() - start == pytest.approx(0.3, abs=0.3)
    assert not port.plugged


def test_outages_that_cannot_be_are_refused() -> None:
    for times in ((0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0)):
        with pytest.raises(HardwareError):
            Outages(*times)
