"""Progress on stderr: that something runs, how much of it is done, and for how long yet."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from typing import TypeVar

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from softfuse.cli.terminal import stderr

T = TypeVar("T")


@contextmanager
def busy(description: str, *, quiet: bool) -> Iterator[None]:
    """Show that something of unknown length runs, and for how long; nothing when quiet or no terminal."""
    with counted(description, quiet=quiet):
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
def counted(description: str, *, quiet: bool) -> Iterator[Callable[[], None]]:
    """Show how many calls of what is given have been made, of an unknown number, and for how long."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[n]}"),
    )
    with Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet)) as progress:
        task = progress.add_task(description, total=None, n="")
        numbers = count(1)
        yield lambda: progress.update(task, n=f"{next(numbers)} done")


@contextmanager
def steps(*, quiet: bool) -> Iterator[Callable[..., Callable[[], None]]]:
    """Show one step of a long work after the other: what is given is called with a step's name and, if that
    is known, its total; and what it returns after each part of the step.
    """
    with ExitStack() as shown:

        def begin(step: str, total: int | None = None) -> Callable[[], None]:
            shown.close()  # one display at a time
            if total is None:
                return shown.enter_context(counted(step, quiet=quiet))
            return shown.enter_context(tracked_calls(step, total=total, quiet=quiet))

        yield begin


def _bar(*, quiet: bool) -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=stderr, transient=True, disable=_hidden(quiet))


def _hidden(quiet: bool) -> bool:
    return quiet or not stderr.is_terminal
