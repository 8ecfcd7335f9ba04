"""softfuse sweep: thousands of presses of a simulated device, on several processes or computers."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.cluster import cluster_of, finished, one_of
from softfuse.cli.interruption import termination_interrupts
from softfuse.cli.sweep_folder import Identity, SweepFolder
from softfuse.cli.sweep_table import SweepTable
from softfuse.cli.sweep_worker import Chunk, Pressed, chunks_of, solve_chunk
from softfuse.cli.terminal import Quiet, busy, out_folder, printable, stdout, tracked
from softfuse.cli.version import installed_version
from softfuse.robot.digest import digest
from softfuse.robot.file import file_text, parse
from softfuse.robot.press_plan import load_plan
from softfuse.robot.press_series import build_series, shortened_cables


def sweep(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    plan: Annotated[Path, typer.Argument(help="What varies (TOML), such as configs/pad_sweep.toml.")],
    out: Annotated[Path, out_folder("Folder for the results; a sweep in it is continued.")],
    scheduler: Annotated[
        str | None, typer.Option(help="A Dask scheduler that you trust, such as tcp://host:8786.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this computer; default: one a core.", min=1)
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Simulate a device under many contacts, forces, cables and moduli; goes on where it stopped."""
    one_of(scheduler, workers)
    text = file_text(config)
    settings, planned = parse(text, config), load_plan(plan)
    series = build_series(planned, settings)
    shortened, most = shortened_cables(planned, settings), planned.contacts[-1]
    version, device = installed_version(), digest(settings)
    pressed = Pressed(text, str(config.resolve()), device, most, shortened, version)
    chunks = chunks_of(pressed, series, planned.cases_per_file)
    identity = Identity(version, digest(planned), device)
    folder = SweepFolder(out, identity, SweepTable(settings, most, shortened).columns)
    done = folder.finished([chunk.cases for chunk in chunks])
    todo = [chunk for chunk in chunks if chunk.number not in done]
    if todo:
        with termination_interrupts():
            _solve(todo, folder, scheduler, workers, quiet=quiet)
    if not quiet:
        results = folder.results([chunk.number for chunk in chunks])
        told = ", ".join(f"{count} {name}" for name, count in results.most_common())
        new = sum(chunk.cases for chunk in todo)
        stdout.print(
            printable(f"{results.total()} cases in {len(chunks)} files in {out}, {new} of them new: {told}"),
            markup=False,
            highlight=False,
            soft_wrap=True,
        )


def _solve(
    chunks: list[Chunk], folder: SweepFolder, scheduler: str | None, workers: int | None, *, quiet: bool
) -> None:
    with ExitStack() as open_until_done:
        with busy("starting workers", quiet=quiet):
            client = open_until_done.enter_context(cluster_of(scheduler, workers, len(chunks)))
        solved = finished(client, solve_chunk, chunks)
        for chunk, rows in tracked(solved, "solving", total=len(chunks), quiet=quiet):
            folder.write(chunk.number, rows)
