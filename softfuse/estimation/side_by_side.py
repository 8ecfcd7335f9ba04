"""Work that is shared out over the cores of this computer."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def side_by_side(one: Callable[..., tuple[np.ndarray, ...]], *many: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `one` finds for each of many, one after the other stacked, as many threads at a time as there are
    cores: a compiled program leaves Python to the others.
    """
    with ThreadPoolExecutor(cores()) as threads:
        found = list(threads.map(one, *many))
    return tuple(np.array(each) for each in zip(*found, strict=True))
