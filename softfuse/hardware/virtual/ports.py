"""Where the packets of a virtual board come out: a port that appears, is listened to or not, and goes away.

A port never waits: a packet for which there is no room, or nobody who listens, is dropped whole, as a board's
would be when its buffer is full. Bytes of a packet that has begun are sent before the next.
"""

import os
import select
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from softfuse.errors import HardwareError

LOOPBACK = "127.0.0.1"
_READ_SIZE = 4096
_ROOM = 16384
"""Bytes that the system may keep for a listener who is behind; a few seconds of a robot."""


class AbstractOutlet(ABC):
    """A port; `open` and `close` may alternate, and it is told by the same name each time where that is
    possible.
    """

    _rest = b""
    """Of a packet whose first bytes have gone; forgotten when whoever had these is gone."""

    @property
    @abstractmethod
    def url(self) -> str:
        """How a host opens it, while it is open."""

    @abstractmethod
    def open(self) -> None:
        """Make the port appear. Raises HardwareError when that is impossible."""

    @abstractmethod
    def close(self) -> None:
        """Make it go away; whoever listens is cut off. Does nothing where it is not open."""

    @property
    @abstractmethod
    def listened(self) -> bool:
        """Whether somebody has opened it."""

    @abstractmethod
    def offer(self, packet: bytes) -> bool:
        """Send a packet if there is somebody to listen and room for its first byte; whether that was so."""

    @abstractmethod
    def hear(self) -> bytes:
        """What the host has sent since the last time."""

    @abstractmethod
    def wait(self, seconds: float) -> None:
        """Wait until there is room again, for so long at most."""

    def _send_whole(self, packet: bytes, write: Callable[[bytes], int]) -> bool:
        """Send the rest of the packet before, then a packet, by `write`, which returns how many bytes it
        took; whether the packet has begun.
        """
        if self._rest:
            self._rest = self._rest[write(self._rest) :]
        if self._rest:
            return False
        taken = write(packet)
        if taken:
            self._rest = packet[taken:]
        return taken > 0


class PseudoTerminal(AbstractOutlet):
    """Looks like a serial port: bytes as they are, no echo, gone when it is closed.

    A new one each time it is opened, with a symbolic link to it that keeps its name.
    """

    def __init__(self, link: Path | None = None) -> None:
        """link: where to put a symbolic link while it is open; one that is there already is replaced."""
        self._link = link
        self._master: int | None = None
        self._name = ""
        self._heard_of = False

    @property
    def url(self):
        """The link, or else the device file."""
        return self._name if self._link is None else str(self._link)

    def open(self):
        """Raises HardwareError where there are none, or a file is in the place of the link."""
        try:
            # Not on Windows.
            import tty

            master, slave = os.openpty()
        except (ImportError, AttributeError, OSError) as error:
            raise HardwareError(f"no pseudo-terminal can be opened here ({error}): use --tcp") from error
        self._name = os.ttyname(slave)
        tty.setraw(slave)
        # Only with the other end closed does the system tell whether somebody else has opened it.
        os.close(slave)
        os.set_blocking(master, False)
        self._master = master
        self._rest = b""
        if self._link is not None:
            self._place(self._link)

    def close(self):
        """The host's end hangs up."""
        if self._master is None:
            return
        if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self._name:
            self._link.unlink()
        os.close(self._master)
        self._master = None

    @property
    def listened(self):
        """Whether the other end is open; what an earlier listener left unread is discarded."""
        there = self._master is not None and not self._polled(self._master, 0.0) & select.POLLHUP
        if not there and self._heard_of:
            self._rest = b""
            if self._master is not None:
                self._discard_unread()
        self._heard_of = there
        return there

    def offer(self, packet):
        master = self._master
        if master is None or not self.listened:
            return False
        return self._send_whole(packet, lambda data: _written(master, data))

    def hear(self):
        if self._master is None or not self._polled(self._master, 0.0) & select.POLLIN:
            return b""
        # The other end may be closed in between.
        with suppress(OSError):
            return os.read(self._master, _READ_SIZE)
        return b""

    def wait(self, seconds):
        if self._master is not None:
            self._polled(self._master, seconds, select.POLLOUT)

    def _discard_unread(self) -> None:
        import termios

        slave = os.open(self._name, os.O_RDWR | os.O_NOCTTY)
        termios.tcflush(slave, termios.TCIFLUSH)
        os.close(slave)

    @staticmethod
    def _polled(master: int, seconds: float, events: int = select.POLLIN) -> int:
        poll = select.poll()
        poll.register(master, events)
        return next((event for _, event in poll.poll(1e3 * seconds)), 0)

    def _place(self, link: Path) -> None:
        if link.exists() and not link.is_symlink():
            self.close()
            raise HardwareError(f"{link} is a file of its own, not a link: give another --link")
        new = link.with_name(f".{link.name}.{os.getpid()}")
        try:
            new.symlink_to(self._name)
            os.replace(new, link)
        except OSError as error:
            self.close()
            raise HardwareError(f"cannot make the link {link}: {error.strerror or error}") from error


def _written(master: int, data: bytes) -> int:
    """How many bytes there was room for."""
    try:
        return os.write(master, data)
    except OSError:
        # Full, or just closed: the next look at it tells.
        return 0


class TcpPort(AbstractOutlet):
    """On loopback, never beyond it, for one listener at a time; others wait until he has gone."""

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
        return self.listened and self._send_whole(packet, self._send)

    def hear(self):
        self._look()
        heard, self._heard = self._heard, b""
        return heard

    def wait(self, seconds):
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
        self._rest = b""


def outlets_of(tcp: int | None, link: Path | None, boards: int) -> list[list[AbstractOutlet]]:
    """The outlets of each board: a pseudo-terminal unless there is a TCP port and no link is asked for."""
    found: list[list[AbstractOutlet]] = []
    for k in range(boards):
        here: list[AbstractOutlet] = []
        if tcp is not None:
            here.append(TcpPort(tcp + k if tcp else 0))
        if link is not None:
            here.append(PseudoTerminal(link if boards == 1 else link.with_name(f"{link.name}{k + 1}")))
        elif tcp is None:
            here.append(PseudoTerminal())
        found.append(here)
    return found
