"""The command `softfuse`."""

from softfuse.cli.app import main

__all__ = ["main"]
