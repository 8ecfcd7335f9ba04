"""An open port: bytes in and out, from whatever the operating system has.

Serial ports are opened by pyserial: /dev/ttyUSB0, COM3, a pseudo-terminal, or one of its addresses.

    socket://host:port      bytes over TCP
    rfc2217://host:port     a serial port that another computer serves
    loop://                 what is written comes back
    hwgrep://words          the first port whose description has the words

Under Linux a device that is plugged in again may get another /dev/ttyUSB number; the names under
/dev/serial/by-id stay. pyserial's spy:// and alt:// are refused: they write files and load classes by name.

udp://host:port is the way to one sensor; nothing is received from anybody else. Nobody is connected in UDP: a
sensor that is switched off is a silence, no error.
"""

import io
import os
import re
import select
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from softfuse.errors import HardwareError

WAIT_S = 0.05
"""How long a read waits for bytes [s]."""
WRITE_WAIT_S = 0.1
"""How long a write waits for a device that does not take bytes [s]."""
LARGEST_READ = 65536
"""Bytes that one read returns at most."""
SCHEMES = ("socket", "rfc2217", "loop", "hwgrep")
"""Kinds of addresses, besides a device's own name."""


class AbstractPort(ABC):
    """Something that is open.

    It belongs to one thread, but for `write` of the few bytes that a stage is stopped with.
    """

    @abstractmethod
    def read(self) -> bytes:
        """What has come, at once, or b"" when nothing has come for WAIT_S; one datagram where there are such.

        OSError when the port is gone.
        """

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send all of it; TimeoutError when the device takes no bytes, OSError when the port is gone."""

    @abstractmethod
    def close(self) -> None:
        """Close it; never raises, and may be repeated."""


@dataclass(frozen=True)
class SerialPort:
    """The name of a port that this computer has, what the device says that it is, and whether this user may
    open it.

    What the device says comes from the device: to be escaped before it reaches a terminal.
    """

    name: str
    description: str
    allowed: bool


def serial_ports() -> list[SerialPort]:
    """All that this computer has, by name; none is opened."""
    from serial.tools import list_ports

    ports = []
    for port in list_ports.comports():
        said = [port.description, port.manufacturer, port.serial_number]
        described = ", ".join(dict.fromkeys(text for text in said if text and text != "n/a"))
        # Only where ports are files.
        allowed = not os.path.exists(port.device) or os.access(port.device, os.R_OK | os.W_OK)
        ports.append(SerialPort(port.device, described, allowed))
    return sorted(ports, key=lambda port: port.name)


def open_serial(url: str, baud: int) -> AbstractPort:
    """The open port at an address, 8 bits, no parity, 1 stop bit; what had come before is dropped.

    OSError where it cannot be opened, HardwareError where the address or the baud rate can never be.
    """
    import serial

    scheme, found, _ = url.partition("://")
    if not url or (found and scheme.lower() not in SCHEMES):
        raise HardwareError(
            f"{url!r} is no port: give its name, such as /dev/ttyUSB0 or COM3, "
            f"or {', '.join(f'{one}://' for one in SCHEMES)}"
        )
    try:
        with _os_errors():
            port = serial.serial_for_url(url, baudrate=baud, exclusive=True, write_timeout=WRITE_WAIT_S)
    except (ValueError, re.error) as error:
        raise HardwareError(f"{url} at {baud} baud: {error}") from error
    opened = _SerialPort(port)
    try:
        with _os_errors():
            port.reset_input_buffer()
    except OSError:
        opened.close()
        raise
    return opened


class _SerialPort(AbstractPort):
    """A port by pyserial, waited for by the operating system where that can."""

    def __init__(self, port: Any) -> None:
        self._port = port
        # Without waiting, pyserial reads all there is in one call; it can only wait for a number of bytes.
        # Only it can wait for loop, rfc2217, and Windows' own.
        try:
            self._handle = port.fileno()
        except (io.UnsupportedOperation, AttributeError):
            self._handle = None
        port.timeout = WAIT_S if self._handle is None else 0

    def read(self) -> bytes:
        with _os_errors():
            if self._handle is None:
                first = self._port.read(1)
                return first + self._port.read(min(self._port.in_waiting, LARGEST_READ)) if first else b""
            ready, _, _ = select.select([self._handle], [], [], WAIT_S)
            return self._port.read(LARGEST_READ) if ready else b""

    def write(self, data: bytes) -> None:
        import serial

        try:
            with _os_errors():
                self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise TimeoutError("the device takes no bytes") from error

    def close(self) -> None:
        with suppress(OSError), _os_errors():
            self._port.close()


@contextmanager
def _os_errors() -> Iterator[None]:
    """What pyserial lets through of the terminal's own errors becomes an OSError."""
    try:
        yield
    except OSError:
        raise
    except _terminal_error() as error:
        raise OSError(*error.args) from error


def _terminal_error() -> type[Exception]:
    try:
        import termios
    except ImportError:
        return OSError
    return termios.error


def open_udp(url: str, default_port: int) -> AbstractPort:
    """The way to the sensor at udp://host or udp://host:port.

    OSError where there is none now, HardwareError for what is no such address.
    """
    host, port = _address(url, default_port)
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    way = socket.socket(family, kind, protocol)
    try:
        way.connect(address)
        way.setblocking(False)
    except OSError:
        way.close()
        raise
    return _UdpPort(way)


def _address(url: str, default_port: int) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port or default_port
    except ValueError as error:
        raise HardwareError(f"{url!r} is no address: {error}") from error
    if parts.scheme != "udp" or not host or parts.path not in ("", "/") or parts.query or parts.fragment:
        raise HardwareError(f"{url!r} is no address of UDP: write it as udp://192.168.1.1:{default_port}")
    return host, port


class _UdpPort(AbstractPort):
    """Datagrams to and from one address."""

    def __init__(self, way: socket.socket) -> None:
        self._way = way

    def read(self) -> bytes:
        try:
            ready, _, _ = select.select([self._way], [], [], WAIT_S)
            return self._way.recv(LARGEST_READ) if ready else b""
        except ConnectionRefusedError:
            # The answer to something sent: the computer is there, the sensor's service is not.
            time.sleep(WAIT_S)
            return b""
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        try:
            self._way.send(data)
        except (ConnectionRefusedError, BlockingIOError) as error:
            raise TimeoutError("the sensor takes no datagram") from error

    def close(self) -> None:
        self._way.close()
