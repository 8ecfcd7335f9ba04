"""What people see: results on stdout; progress, logs and errors on stderr."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from softfuse.errors import SoftfuseError

T = TypeVar("T")

stdout = Console()
stderr = Console(stderr=True)

Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress and no tables, only errors.")]
"""The option --quiet of every command."""


def _writable_file(path: Path | None) -> Path | None:
    """The path of a file that a command will write, checked before its work: SoftfuseError."""
    if path is None:
        return path
    if path.is_dir():
        raise SoftfuseError(f"{path} cannot be written: it is a folder, give a file")
    if not path.parent.is_dir():
        raise SoftfuseError(f"{path} cannot be written: there is no folder {path.parent}")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise SoftfuseError(f"{path} cannot be written: no permission, choose another place")
    return path


def _writable_folder(path: Path) -> Path:
    """The path of a folder that a command will make or write in, checked before its work: SoftfuseError."""
    there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not there.is_dir():
        raise SoftfuseError(f"{path} cannot be written: {there} is a file, give a folder")
    if not os.access(there, os.W_OK):
        raise SoftfuseError(f"{path} cannot be written: no permission in {there}, choose another place")
    return path


def out_file(*names: str, help: str) -> Any:
    """An option for a file to write."""
    return typer.Option(*names, help=help, callback=_writable_file)


def out_folder(help: str) -> Any:
    """An option for a folder to write in."""
    return typer.Option(help=help, callback=_writable_folder)


Charts = Annotated[
    Path | None,
    typer.Option(
        "--charts", help="Estimate in real time, with the charts that softfuse reduce has put there."
    ),
]
"""The option --charts of commands that estimate."""


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
def busy(description: str, *, quiet: bool) -> Iterator[None]:
    """Show that something of unknown length runs, and for how long; nothing when quiet or no terminal."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet)) as progress:
        progress.add_task(description, total=None)
        yield


def tracked(items: Iterable[T], description: str, *, total: int | None, quiet: bool) -> Iterator[T]:
    """The items one by one, with a bar that shows how many of the total are done and the time left."""
    with _bar(quiet=quiet) as progress:
        yield from progress.track(items, total=total, description=description)


@contextmanager
def tracked_calls(description: str, *, total: int, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show with a bar how many of a total of calls of what is given have been made, and the time left."""
    with _bar(quiet=quiet) as progress:
        task = progress.add_task(description, total=total)
        yield lambda: progress.advance(task)


@contextmanager
def counted(description: str, what: str, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show how many of something have been done, of which nobody knows how many there will be, and for how
    long; each call of what is given counts one.
    """
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[n]}"),
    )
    with Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet)) as progress:
        task = progress.add_task(description, total=None, n="")
        numbers = count(1)
        yield lambda: progress.update(task, n=f"{next(numbers)} {what}")


def _bar(*, quiet: bool) -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet))


def _hidden(quiet: bool) -> bool:
    return quiet or not stderr.is_terminal
