"""softfuse sweep: thousands of presses of a simulated robot, on several processes or computers."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet, out_folder
from softfuse.cli.progress import steps
from softfuse.cli.terminal import say
from softfuse.cli.workers import Scheduler, Workers
from softfuse.experiment.sweep import SweepFolder, chunks_of, solve_chunk
from softfuse.robot.digest import digest
from softfuse.robot.file import file_text, parse
from softfuse.robot.press_plan import load_plan


def sweep(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    plan: Annotated[Path, typer.Argument(help="What varies (TOML), such as configs/pad_sweep.toml.")],
    out: Annotated[Path, out_folder("Folder for the results; a sweep in it is continued.")],
    scheduler: Scheduler = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this computer; default: one a core.", min=1)
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Simulate a robot under many contacts, forces, actuators and moduli; goes on where it stopped."""
    processes = Workers(scheduler, workers)
    text = file_text(config)
    settings, planned = parse(text, config), load_plan(plan)
    chunks = chunks_of(text, settings, planned)
    identity = {"plan": digest(planned), "config": digest(settings)}
    folder = SweepFolder(out, identity, chunks[0].swept.table(settings).columns)
    todo = [chunk for chunk in chunks if not folder.has(chunk.number, chunk.cases)]
    if todo:
        with (
            steps(quiet=quiet) as begin,
            processes.share(solve_chunk, todo, "solving", begin) as solved,
        ):
            for chunk, rows in solved:
                folder.write(chunk.number, rows)
    results, new = folder.results(len(chunks)), sum(chunk.cases for chunk in todo)
    ends = ", ".join(f"{count} {name}" for name, count in results.most_common())
    say(f"{results.total()} cases in {len(chunks)} files in {out}, {new} of them new: {ends}", quiet=quiet)
