"""softfuse design: cavities that tell forces, places or shapes better, found by gradients."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_folder
from softfuse.cli.progress import steps
from softfuse.cli.terminal import say
from softfuse.cli.workers import Scheduler, Workers
from softfuse.design.plan import load_design
from softfuse.report.design_run import designed


def design(
    plan: Annotated[Path, typer.Argument(help="What is looked for (TOML), such as configs/design_pad.toml.")],
    out: Annotated[Path, out_folder("Folder for the results; a run in it is continued.")],
    scheduler: Scheduler = None,
    workers: Annotated[
        int | None, typer.Option(help="Search starts in so many processes on this computer.", min=1)
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Find cavities whose readings tell more, and write the robot, its mould and a report."""
    processes = Workers(scheduler, workers)
    share = None if scheduler is None and workers is None else processes.share
    with steps(quiet=quiet) as begin:
        found = designed(load_design(plan), out, share=share, begin=begin)
    say(*found, f"written to {out}", quiet=quiet)
