"""What people see: results on stdout; progress, logs and errors on stderr."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Annotated, TypeVar

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

T = TypeVar("T")

stdout = Console()
stderr = Console(stderr=True)

Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress and no tables, only errors.")]
"""The option --quiet of every command."""


@contextmanager
def busy(description: str, *, quiet: bool) -> Iterator[None]:
    """Show that something of unknown length runs, and for how long; nothing when quiet or no terminal."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet)) as progress:
        progress.add_task(description, total=None)
        yield


def tracked(items: Iterable[T], description: str, *, total: int, quiet: bool) -> Iterator[T]:
    """The items one by one, with a bar that shows how many of the total are done and the time left."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet)) as progress:
        yield from progress.track(items, total=total, description=description)


def _hidden(quiet: bool) -> bool:
    return quiet or not stderr.is_terminal
