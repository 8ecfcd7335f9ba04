"""Checks of softfuse's annotations, shapes among them, as the tests call it; and ways past them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import Mock

import typeguard
from jaxtyping import config, install_import_hook, jaxtyped

CHECKED = ("body", "calibration", "design", "functional", "material", "mechanics", "mesh", "rom", "sensors")
"""Packages of softfuse; what the annotations of the others say has not been compared with all their tests."""

_check_class = typeguard.check_tuple


def _check_by_itself(*given: Any) -> None:
    """A named tuple's sizes are its own, like those of other classes: k readings of each of some sensors."""
    with jaxtyped("context"):
        _check_class(*given)


def install() -> None:
    """Check what is imported of these packages after this."""
    # Tuples that are no classes, such as tuple[int, str], are checked elsewhere.
    typeguard.check_tuple = _check_by_itself
    install_import_hook([f"softfuse.{name}" for name in CHECKED], "typeguard.typechecked")


@contextmanager
def unchecked() -> Iterator[None]:
    """Nothing is checked: for what no annotation allows, to see it refused."""
    config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        config.update("jaxtyping_disable", False)


def stand_in(**fields: Any) -> Any:
    """An object of these fields only, which is let pass as any."""
    return Mock(spec_set=[*fields], **fields)
