"""What people see: results on stdout; progress, logs and errors on stderr."""

import logging
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console

stdout = Console()
stderr = Console(stderr=True)


def say(*lines: str, quiet: bool = False, console: Console = stdout) -> None:
    """Print lines as they are, unless quiet; nothing in them can command a terminal."""
    if not quiet:
        console.print(printable("\n".join(lines)), markup=False, highlight=False, soft_wrap=True)


def printable(text: str) -> str:
    """The text with what could command a terminal escaped: control characters and the like, but line ends."""
    return "".join(
        sign if sign.isprintable() or sign == "\n" else sign.encode("unicode_escape").decode()
        for sign in text
    )


def escape_log(record: logging.LogRecord) -> bool:
    """A filter of log records that lets all pass, printable."""
    record.msg, record.args = printable(record.getMessage()), None
    return True


@contextmanager
def termination_interrupts() -> Iterator[None]:
    """Within, SIGTERM raises KeyboardInterrupt as Ctrl-C does; for the main thread."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
