"""Which softfuse is installed, which client and workers, and runs in one folder, must have in common."""

import importlib.metadata

from softfuse.errors import SoftfuseError


def installed_version() -> str:
    """The version of softfuse that is installed here."""
    return importlib.metadata.version("softfuse")


def require_version(version: str) -> None:
    """Raises SoftfuseError when this worker has another softfuse than the client."""
    if installed_version() != version:
        raise SoftfuseError(
            f"a worker has softfuse {installed_version()}, here it is {version}: install the same"
        )
