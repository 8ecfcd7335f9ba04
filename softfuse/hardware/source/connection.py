"""A source that is kept open: a thread reads it, and opens it again when it went away and comes back.

The thread hands out each piece of bytes as a Chunk with the host's time right after the read, and one empty
Chunk before the first bytes after an interruption, so that whoever replays the chunks knows where the line
was cut. What is wrong is handed out as Notices. Both callbacks run in the thread and must be quick.

While nothing comes for GREET_AGAIN_S, the driver's greeting is sent again: a sensor that lost its power
forgets that it was started.
"""

import errno
import logging
import threading
from collections import deque
from collections.abc import Callable
from time import monotonic

from softfuse.errors import HardwareError
from softfuse.hardware.source.port import AbstractPort
from softfuse.hardware.stream import Chunk, HostClock, Level, Notice

POLL_S = 0.2
"""How often a port that went away is tried [s]."""
PAUSE_S = 0.1
"""Between the parts of a greeting [s]."""
GREET_AGAIN_S = 0.5
SILENT_S = 3.0
"""A silence that people are told of [s]."""
STOP_S = 0.5
"""How long a stop waits for the thread [s]."""
MOST_UNSENT = 64
"""Messages that wait to be sent; more are refused."""

_log = logging.getLogger(__name__)
SILENCE = f"nothing has come for {SILENT_S:g} s: is the device on, its cable in, and the baud rate its own?"


class Connection:
    """One source, from `open` to `stop`."""

    def __init__(
        self,
        source: int,
        url: str,
        open_port: Callable[[], AbstractPort],
        on_chunk: Callable[[Chunk], None],
        on_notice: Callable[[Notice], None],
        clock: HostClock,
        *,
        greeting: tuple[bytes, ...] = (),
        farewell: bytes = b"",
    ) -> None:
        """source: its number from 0; url: for people; open_port raises OSError while there is none."""
        self._source = source
        self._url = url
        self._open_port = open_port
        self._on_chunk = on_chunk
        self._on_notice = on_notice
        self._clock = clock
        self._greeting = greeting
        self._farewell = farewell
        self._stop = threading.Event()
        self._connected = threading.Event()
        self._unsent: deque[bytes] = deque()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Open the port and begin to read it; HardwareError, which says what to do, where it cannot be."""
        if self._thread is not None:
            raise RuntimeError("a connection is opened once: make a new one")
        try:
            port = self._open_port()
        except OSError as error:
            raise HardwareError(remedy(self._url, error)) from error
        self._connected.set()
        self._tell("info", f"{self._url}: open")
        self._thread = threading.Thread(target=self._run, args=(port,), name=self._url, daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> bool:
        """Send bytes soon, from any thread; whether they are taken: not while the port is away."""
        if not self._connected.is_set() or len(self._unsent) >= MOST_UNSENT:
            return False
        self._unsent.append(data)
        return True

    def stop(self) -> None:
        """Close the port, from any thread; back within 0.5 s, and nothing is handed out after that.

        A port that is just being opened over a network is closed by its thread when that has ended.
        """
        self._stop.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(STOP_S)

    def _run(self, port: AbstractPort) -> None:
        while True:
            reason = self._read(port)
            self._connected.clear()
            self._unsent.clear()
            if reason is None:
                self._part(port)
                return
            lost = monotonic()
            self._tell("warning", f"{self._url}: lost, {reason}; waiting for it to come back")
            port.close()
            back = self._reopened()
            if back is None:
                return
            port = back
            self._connected.set()
            self._hand_out(b"")
            away = monotonic() - lost
            self._tell("info", f"{self._url}: back after {away:.2f} s, in which nothing was read")

    def _read(self, port: AbstractPort) -> OSError | None:
        """Hand out what comes until the port goes away, for which reason, or until the stop."""
        greeting = deque(self._greeting)
        heard = greeted = monotonic()
        next_part = heard
        silent = False
        try:
            while not self._stop.is_set():
                now = monotonic()
                if greeting and now >= next_part:
                    self._write(port, greeting.popleft())
                    greeted, next_part = now, now + PAUSE_S
                if self._unsent:
                    self._write(port, self._unsent.popleft())
                data = port.read()
                now = monotonic()
                if data:
                    self._hand_out(data)
                    if silent:
                        self._tell("info", f"{self._url}: bytes again after {now - heard:.2f} s")
                    heard, silent = now, False
                    continue
                if not greeting and now - max(heard, greeted) > GREET_AGAIN_S:
                    greeting.extend(self._greeting)
                    greeted = now
                if not silent and now - heard > SILENT_S:
                    silent = True
                    self._tell("warning", f"{self._url}: {SILENCE}")
        except OSError as error:
            return error
        return None

    def _write(self, port: AbstractPort, data: bytes) -> None:
        try:
            port.write(data)
        except TimeoutError as error:
            # What waits behind it would hold up the reading as long, one by one.
            self._unsent.clear()
            _log.info("%s: %s", self._url, error)

    def _reopened(self) -> AbstractPort | None:
        """The port, when it has come back; None after the stop."""
        while not self._stop.wait(POLL_S):
            try:
                port = self._open_port()
            except OSError as error:
                _log.debug("%s: %s", self._url, error)
                continue
            if not self._stop.is_set():
                return port
            port.close()
        return None

    def _part(self, port: AbstractPort) -> None:
        try:
            if self._farewell:
                port.write(self._farewell)
        except OSError as error:
            _log.debug("%s: %s", self._url, error)
        port.close()

    def _hand_out(self, data: bytes) -> None:
        if not self._stop.is_set():
            self._on_chunk(Chunk(self._source, self._clock.now_s(), data))

    def _tell(self, level: Level, text: str) -> None:
        if not self._stop.is_set():
            self._on_notice(Notice(self._clock.now_s(), self._source, level, text))


def remedy(url: str, error: OSError) -> str:
    """What is wrong with a port, and what to do, in one line."""
    match _number(error):
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            return f"{url}: there is no such port: plug the device in, or list the ports with softfuse doctor"
        case errno.EACCES | errno.EPERM:
            return (
                f"{url}: no permission: add yourself to the group that owns it "
                "(sudo usermod -aG dialout $USER under most Linuxes), then log in again"
            )
        case errno.EBUSY | errno.EAGAIN:
            return f"{url}: busy: close the other program that uses it"
        case errno.ECONNREFUSED:
            return f"{url}: nobody listens there: start the device's server, or check the port number"
        case errno.ENOTTY | errno.EINVAL:
            return f"{url}: is no serial port: check the name"
        case _:
            return f"{url}: cannot be opened: {error}"


def _number(error: BaseException | None) -> int | None:
    """The error's number, which pyserial leaves out in places, or that of what it came from."""
    while error is not None:
        # That of an OSError, and of termios' own error, which is none.
        if error.args and isinstance(error.args[0], int):
            return error.args[0]
        error = error.__cause__ or error.__context__
    return None
