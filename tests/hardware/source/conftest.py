"""Ports of the operating system to test against, and what a connection hands out."""

import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from softfuse.hardware.stream import Chunk, Notice

PATIENCE_S = 20.0


class Plug:
    """A device on a pseudo-terminal under a name that stays, as /dev/serial/by-id does."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.master = -1
        self.plug()

    def plug(self) -> float:
        """Plug it in; when [s, monotonic]."""
        self.master, slave = os.openpty()
        new = self.path.with_name("new")
        new.symlink_to(os.ttyname(slave))
        new.replace(self.path)
        os.close(slave)
        return time.monotonic()

    def unplug(self) -> None:
        """Pull it out."""
        self.path.unlink()
        master, self.master = self.master, -1
        os.close(master)

    def send(self, data: bytes) -> None:
        """What the device sends."""
        os.write(self.master, data)

    def heard(self, size: int) -> bytes:
        """The next bytes that came to the device; while nobody has opened it, none can come."""
        data = b""
        deadline = time.monotonic() + PATIENCE_S
        while len(data) < size:
            assert time.monotonic() < deadline, data
            if select.select([self.master], [], [], 0.1)[0]:
                try:
                    data += os.read(self.master, size - len(data))
                except OSError:
                    time.sleep(0.01)
        return data


class Log:
    """What a connection hands out, by its thread."""

    def __init__(self) -> None:
        self.chunks: list[Chunk] = []
        self.chunk_times: list[float] = []
        self.notices: list[Notice] = []
        self._changed = threading.Condition()

    def on_chunk(self, chunk: Chunk) -> None:
        with self._changed:
            self.chunks.append(chunk)
            self.chunk_times.append(time.monotonic())
            self._changed.notify_all()

    def on_notice(self, notice: Notice) -> None:
        with self._changed:
            self.notices.append(notice)
            self._changed.notify_all()

    @property
    def data(self) -> bytes:
        return b"".join(chunk.data for chunk in self.chunks)

    @property
    def texts(self) -> list[str]:
        return [f"{notice.level} {notice.text}" for notice in self.notices]

    def wait(self, condition: Callable[["Log"], bool]) -> None:
        with self._changed:
            done = self._changed.wait_for(lambda: condition(self), PATIENCE_S)
        assert done, (self.data[-200:], self.texts)


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    """A device that is plugged in."""
    plug = Plug(tmp_path / "usb-device")
    yield plug
    if plug.master >= 0:
        plug.unplug()


@pytest.fixture
def log() -> Log:
    """Listens to a connection."""
    return Log()
