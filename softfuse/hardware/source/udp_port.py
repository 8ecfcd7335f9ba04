"""UDP to one sensor, udp://host:port; nothing is received from anybody else.

Nobody is connected in UDP: a sensor that is switched off is a silence, no error.
"""

import select
import socket
import time
from urllib.parse import urlsplit

from softfuse.errors import HardwareError
from softfuse.hardware.source.port import LARGEST_READ, WAIT_S, AbstractPort


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
        """The next datagram, or b"" after WAIT_S."""
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
        """Send one datagram."""
        try:
            self._way.send(data)
        except (ConnectionRefusedError, BlockingIOError) as error:
            raise TimeoutError("the sensor takes no datagram") from error

    def close(self) -> None:
        """Close it."""
        self._way.close()
