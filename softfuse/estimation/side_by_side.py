"""Work that is shared out over the cores of this computer."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

T = TypeVar("T")


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shared_out(one: Callable[..., T], *many: Iterable) -> Iterator[T]:
    """What `one` finds for each of many, in their order, as many threads at a time as there are cores: a
    compiled program leaves Python to the others.

    Whoever stops waiting waits only for what has been begun.
    """
    threads = ThreadPoolExecutor(cores())
    try:
        yield from threads.map(one, *many)
    finally:
        threads.shutdown(cancel_futures=True)


def side_by_side(one: Callable[..., tuple[np.ndarray, ...]], *many: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `one` finds for each of many, shared out over the cores, one after the other stacked."""
    return tuple(np.array(each) for each in zip(*shared_out(one, *many), strict=True))
