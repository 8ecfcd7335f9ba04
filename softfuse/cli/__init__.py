"""The command `softfuse`."""

import os
from collections.abc import Sequence

# OpenBLAS reads this when scipy loads it. Its threads wait for each other in loops: where other processes
# kept the cores busy, a factor of the tangent was seen to take ten times as long with two as with one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command of the arguments, by default those of the process, and exit.

    Raises SystemExit with the exit code.
    """
    from softfuse.cli.app import main as run

    run(arguments)


__all__ = ["main"]
