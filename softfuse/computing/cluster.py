"""Pieces of work on the processes of a Dask cluster, on this computer or behind a scheduler's address.

Who can reach a scheduler can run programs on its workers and its clients: Dask sends pickled objects. So the
cluster on this computer listens on the loopback address only, with certificates of its own that live as long
as the command, and without a dashboard; and an address that is given must be trusted.
"""

import asyncio
import logging
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from softfuse.computing.prepare import prepare_jax
from softfuse.errors import SoftfuseError

if TYPE_CHECKING:
    from distributed import Client

log = logging.getLogger(__name__)

# As for the command itself, see `softfuse.cli`: a worker elsewhere imports this before it loads scipy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class Piece(Protocol):
    """What a worker is given; it names itself where it is told of."""

    @property
    def title(self) -> str:
        """Such as "case 12"."""
        ...


_P = TypeVar("_P", bound=Piece)
_R = TypeVar("_R")

_LOOPBACK = "127.0.0.1"
_ANSWER_S = 10
"""How long a scheduler may take to answer."""
_EVENTS = "all"
"""Dask's topic of what happens to workers."""


def dask_setup(worker: object) -> None:
    """Leave a Ctrl-C to the client, which ends its workers: called by Dask in those of this computer."""
    del worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def local_cluster(workers: int, cores: int) -> "Iterator[Client]":
    """A client of so many processes on the cores of this computer, which end with it.

    Raises SoftfuseError when Dask is not installed.
    """
    with _dask():
        import cryptography  # noqa: F401  Dask makes the certificates with it
        from distributed import Client, LocalCluster, Security
    make: Any = LocalCluster  # its annotations do not know what its documentation allows
    cluster = make(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host=_LOOPBACK,
        security=Security.temporary(),
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": f"{_LOOPBACK}:0"},
        worker_dashboard_address=None,
        # Workers keep no data that could be moved to disk, and compiling may need much memory for a while.
        memory_limit=0,
        silence_logs=logging.CRITICAL,
        preload=["softfuse.computing.cluster"],
        # XLA would otherwise start as many threads in every process as there are cores.
        env={"NPROC": str(max(1, cores // workers))},
    )
    with cluster, Client(cluster) as client:
        yield client


@contextmanager
def remote_cluster(address: str) -> "Iterator[Client]":
    """A client of the scheduler at an address such as tcp://host:8786.

    Raises SoftfuseError when Dask is not installed or no scheduler answers there.
    """
    with _dask():
        from distributed import Client
    try:
        # A client that finds none stays half made: collected while another starts, it stops both for ever.
        asyncio.run(_reach(address))
        client = Client(address, timeout=_ANSWER_S)
    except (OSError, ValueError) as error:
        raise SoftfuseError(
            f"--scheduler {address}: no Dask scheduler answers there: {_first_line(error)}"
        ) from error
    with client:
        if not client.scheduler_info()["workers"]:
            log.warning("the scheduler at %s has no workers yet, waiting for them", address)
        yield client


async def _reach(address: str) -> None:
    """Raises OSError when nothing listens at an address, ValueError for what is none."""
    from distributed.comm.core import connect

    (await connect(address, timeout=_ANSWER_S)).abort()


def finished(client: "Client", work: Callable[[_P], _R], pieces: Sequence[_P]) -> Iterator[tuple[_P, _R]]:
    """The pieces with what `work` makes of each, as they are finished.

    What a worker that dies was at is done again by another one, and told. Raises SoftfuseError when work
    does, when a worker has another softfuse or lacks something, or, after all others, when some pieces have
    cost one worker after the other.
    """
    from distributed import KilledWorker, as_completed
    from distributed.client import FutureCancelledError

    client.subscribe_topic(_EVENTS, _tell_of_workers)
    # Keys are always new: a scheduler may still know those of a command that was interrupted.
    futures = {
        client.submit(prepared, version("softfuse"), work, piece, pure=False): piece for piece in pieces
    }
    deadly = []
    try:
        for future in as_completed(list(futures)):
            piece = futures.pop(future)
            try:
                made = future.result()
            except KilledWorker:
                deadly.append(piece)
            except ImportError as error:
                raise SoftfuseError(f"a worker lacks something ({error}): install softfuse there") from error
            except FutureCancelledError as error:
                raise SoftfuseError(
                    "the connection to the scheduler was lost; run the same again to go on"
                ) from error
            else:
                yield piece, made
            future.release()
    finally:
        client.unsubscribe_topic(_EVENTS)
        client.cancel(list(futures))
    if deadly:
        raise SoftfuseError(
            f"{len(deadly)} parts of the work each cost several workers their lives, the first at "
            f"{deadly[0].title}: give them more memory; all others are done"
        )


def prepared(wanted: str, work: Callable[[_P], _R], piece: _P) -> _R:
    """What `work` makes of a piece in double precision; SoftfuseError unless softfuse is as `wanted` here."""
    if version("softfuse") != wanted:
        raise SoftfuseError(
            f"a worker has softfuse {version('softfuse')}, here it is {wanted}: install the same"
        )
    prepare_jax()
    return work(piece)


def _tell_of_workers(event: tuple[float, Any]) -> None:
    _, message = event
    if message.get("action") == "remove-worker" and not message.get("expected"):
        busy = len(message.get("processing-tasks", ()))
        log.warning("the worker %s has died, %d parts of the work are done again", message["worker"], busy)


@contextmanager
def _dask() -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        raise SoftfuseError(f"several workers need Dask ({error}): pip install 'softfuse[sweep]'") from error
    # What a user should know of it is told by this module.
    for name in ("distributed", "distributed.client", "distributed.gc"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]
