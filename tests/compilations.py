"""What JAX traces or compiles while something runs."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import jax
from jax import monitoring


@contextmanager
def compilations(*, beside: bool = True) -> Iterator[list[str]]:
    """The events so far, by JAX's names, on any thread; or, not of what is done `beside`, on this one."""
    events: list[str] = []
    here = threading.get_ident()

    def listen(event: str, *_: object, **__: object) -> None:
        if (beside or threading.get_ident() == here) and ("compile" in event or "trace" in event):
            events.append(event)

    monitoring.register_event_duration_secs_listener(listen)
    try:
        yield events
    finally:
        monitoring.unregister_event_duration_listener(listen)


def heard() -> bool:
    """Whether a compilation is heard at all."""
    with compilations() as events:
        jax.jit(lambda x: x + 1.0)(0.0)
    return bool(events)
