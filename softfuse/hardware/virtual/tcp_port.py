"""A TCP port on loopback, never beyond it, for one listener at a time."""

import select
import socket
from contextlib import suppress

from softfuse.errors import HardwareError
from softfuse.hardware.virtual.outlet import AbstractOutlet, Backlog

LOOPBACK = "127.0.0.1"
_READ_SIZE = 4096
_ROOM = 16384
"""Bytes that the system may keep for a listener who is behind; a few seconds of a robot."""


class TcpPort(AbstractOutlet):
    """Accepts a connection while it has none; others wait until that one is closed."""

    def __init__(self, port: int) -> None:
        """port: its number, 0 for any free one, which it then keeps. Raises HardwareError for no number of a
        port.
        """
        if not 0 <= port <= 65535:
            raise HardwareError(f"{port} is no TCP port: give a number up to 65535")
        self._port = port
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self._heard = b""
        self._backlog = Backlog()

    @property
    def url(self):
        """As pyserial wants it."""
        return f"socket://{LOOPBACK}:{self._port}"

    def open(self):
        """Raises HardwareError when the port is taken or not allowed."""
        server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind((LOOPBACK, self._port))
        except OSError as error:
            server.close()
            why = error.strerror or error
            raise HardwareError(
                f"cannot listen on TCP port {self._port}: {why}; give another --tcp"
            ) from error
        server.listen(1)
        server.setblocking(False)
        self._port = server.getsockname()[1]
        self._server = server

    def close(self):
        """The connection ends and no new one can be made."""
        self._hang_up()
        if self._server is not None:
            self._server.close()
            self._server = None

    @property
    def listened(self):
        """Whether there is a connection; takes one that is waiting."""
        self._look()
        if self._client is None and self._server is not None:
            with suppress(OSError):
                client, _ = self._server.accept()
                client.setblocking(False)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
                self._client = client
        return self._client is not None

    def offer(self, packet):
        """See AbstractOutlet."""
        return self.listened and self._backlog.send(packet, self._send)

    def hear(self):
        """See AbstractOutlet."""
        self._look()
        heard, self._heard = self._heard, b""
        return heard

    def wait(self, seconds):
        """See AbstractOutlet."""
        if self._client is not None:
            select.select([], [self._client], [], seconds)

    def _look(self) -> None:
        """Take what has come, and notice that the connection has ended."""
        if self._client is None:
            return
        try:
            data = self._client.recv(_READ_SIZE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        # What nobody asks for must not pile up.
        self._heard = (self._heard + data)[-_READ_SIZE:]

    def _send(self, data: bytes) -> int:
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._hang_up()
            return 0

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
        self._backlog.clear()
