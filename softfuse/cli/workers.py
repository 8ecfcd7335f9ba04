"""Processes that work is shared out over, here or behind a scheduler, and the option that asks for them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, TypeVar

import typer

from softfuse.cli.terminal import termination_interrupts
from softfuse.computing.cluster import Piece, finished, local_cluster, remote_cluster
from softfuse.errors import SoftfuseError
from softfuse.estimation.batch import cores

P = TypeVar("P", bound=Piece)
R = TypeVar("R")
T = TypeVar("T")

Scheduler = Annotated[
    str | None,
    typer.Option(help="A Dask scheduler that you trust, such as tcp://host:8786: its workers do the work."),
]


@dataclass(frozen=True)
class Workers:
    """Those of a Dask scheduler at an address, or so many processes on this computer, None: one a core."""

    scheduler: str | None
    processes: int | None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.processes is not None:
            raise SoftfuseError("--workers are processes on this computer, --scheduler has its own: give one")

    @contextmanager
    def share(
        self, work: Callable[[P], R], pieces: Sequence[P], step: str, begin: Callable[..., Callable[[], None]]
    ) -> Iterator[Iterator[tuple[P, R]]]:
        """The pieces with what `work` makes of each, as they are finished; `begin` shows the step.

        Raises SoftfuseError as `remote_cluster`, `local_cluster` and `finished` do.
        """
        begin("starting workers")
        if self.scheduler is not None:
            cluster = remote_cluster(self.scheduler)
        else:
            cluster = local_cluster(min(self.processes or cores(), len(pieces)), cores())
        with termination_interrupts(), cluster as client:
            yield _counted(finished(client, work, pieces), begin(step, len(pieces)))


def _counted(items: Iterator[T], done: Callable[[], None]) -> Iterator[T]:
    for item in items:
        yield item
        done()
