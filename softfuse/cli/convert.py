"""softfuse convert: sessions, CSV and Parquet into each other."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.terminal import Quiet, busy, stdout
from softfuse.hardware.record.convert import convert_estimates, convert_frames


def convert(
    source: Annotated[Path, typer.Argument(help="Session (.mcap), .csv, .csv.gz or .parquet.")],
    target: Annotated[Path, typer.Argument(help="File to write; its suffix says as what.")],
    estimates: Annotated[
        bool, typer.Option("--estimates", help="Convert a session's estimates instead of its frames.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file if it exists.")] = False,
    quiet: Quiet = False,
) -> None:
    """Convert a recording: sessions, CSV and Parquet into each other."""
    act = convert_estimates if estimates else convert_frames
    with busy("converting", quiet=quiet):
        count = act(source, target, overwrite=force)
    if not quiet:
        what = "estimates" if estimates else "frames"
        stdout.print(f"{count} {what} written to {target}", markup=False, highlight=False, soft_wrap=True)
