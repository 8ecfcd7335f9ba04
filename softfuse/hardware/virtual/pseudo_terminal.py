"""A pseudo-terminal that looks like a serial port: bytes as they are, no echo, gone when it is closed."""

import os
import select
from contextlib import suppress
from pathlib import Path

from softfuse.errors import HardwareError
from softfuse.hardware.virtual.outlet import AbstractOutlet, Backlog

_READ_SIZE = 4096


class PseudoTerminal(AbstractOutlet):
    """A new pseudo-terminal each time it is opened, with a symbolic link to it that keeps its name."""

    def __init__(self, link: Path | None = None) -> None:
        """link: where to put a symbolic link while it is open; one that is there already is replaced."""
        self._link = link
        self._master: int | None = None
        self._name = ""
        self._backlog = Backlog()
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
        self._backlog.clear()
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
            self._backlog.clear()
            if self._master is not None:
                self._discard_unread()
        self._heard_of = there
        return there

    def offer(self, packet):
        """See AbstractOutlet."""
        master = self._master
        if master is None or not self.listened:
            return False
        return self._backlog.send(packet, lambda data: _written(master, data))

    def hear(self):
        """See AbstractOutlet."""
        if self._master is None or not self._polled(self._master, 0.0) & select.POLLIN:
            return b""
        # The other end may be closed in between.
        with suppress(OSError):
            return os.read(self._master, _READ_SIZE)
        return b""

    def wait(self, seconds):
        """See AbstractOutlet."""
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
