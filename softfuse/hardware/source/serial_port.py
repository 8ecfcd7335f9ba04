"""Serial ports by pyserial: /dev/ttyUSB0, COM3, a pseudo-terminal, or one of its addresses.

    socket://host:port      bytes over TCP
    rfc2217://host:port     a serial port that another computer serves
    loop://                 what is written comes back
    hwgrep://words          the first port whose description has the words

Under Linux a device that is plugged in again may get another /dev/ttyUSB number; the names under
/dev/serial/by-id stay. pyserial's spy:// and alt:// are refused: they write files and load classes by name.
"""

import io
import os
import re
import select
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from softfuse.errors import HardwareError
from softfuse.hardware.source.port import LARGEST_READ, WAIT_S, WRITE_WAIT_S, AbstractPort

SCHEMES = ("socket", "rfc2217", "loop", "hwgrep")
"""Kinds of addresses, besides a device's own name."""


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
        """What has come, or b"" after WAIT_S."""
        with _os_errors():
            if self._handle is None:
                first = self._port.read(1)
                return first + self._port.read(min(self._port.in_waiting, LARGEST_READ)) if first else b""
            ready, _, _ = select.select([self._handle], [], [], WAIT_S)
            return self._port.read(LARGEST_READ) if ready else b""

    def write(self, data: bytes) -> None:
        """Send all of it."""
        import serial

        try:
            with _os_errors():
                self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise TimeoutError("the device takes no bytes") from error

    def close(self) -> None:
        """Close it."""
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
