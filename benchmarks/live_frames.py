"""What live frames take, and what is compiled meanwhile."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import jax
import numpy as np

from softfuse.estimation.estimator import Estimator


@contextmanager
def compilations() -> Iterator[list[str]]:
    """A list to which JAX's events of tracing and compiling are added, until the end of the block."""
    found: list[str] = []

    def heard(name: str, *_: object, **__: object) -> None:
        if "compile" in name or "trace" in name:
            found.append(name)

    jax.monitoring.register_event_duration_secs_listener(heard)
    try:
        yield found
    finally:
        jax.monitoring.clear_event_listeners()


def wait_until_compiled(estimator: Estimator) -> None:
    """As after some seconds of running."""
    live = estimator.live
    live.begin(live.first, live.first.rest, live.places)


def latencies(taken: Sequence[tuple[float, float]]) -> dict[str, list[float]]:
    """50 and 99 % [ms] of the seconds (f, 2) that estimates and shapes took, and of both together."""
    estimate, shape = 1e3 * np.transpose(taken)
    parts = {"estimate_ms": estimate, "shape_ms": shape, "frame_ms": estimate + shape}
    return {key: np.percentile(each, [50, 99]).tolist() for key, each in parts.items()}


def to_and_fro(length: int, frames: int) -> np.ndarray:
    """Where so many frames (f,) are on a path of that length, which turns at its ends."""
    back = length - 1
    return np.abs((np.arange(frames) + back) % (2 * back) - back)
