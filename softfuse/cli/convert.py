"""softfuse convert: sessions, CSV and Parquet into each other."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet
from softfuse.cli.progress import busy
from softfuse.cli.terminal import say
from softfuse.hardware.record.convert import convert_estimates, convert_frames
from softfuse.robot.file import file_text, validated
from softfuse.robot.recording import RecordingFile, RecordingSettings


def convert(
    source: Annotated[Path, typer.Argument(help="Session (.mcap), .csv, .csv.gz or .parquet.")],
    target: Annotated[Path, typer.Argument(help="File to write; its suffix says as what.")],
    estimates: Annotated[
        bool, typer.Option("--estimates", help="Convert a session's estimates instead of its frames.")
    ] = False,
    form: Annotated[
        Path | None,
        typer.Option(
            "--format",
            help="TOML whose table \\[recording] tells how a CSV is written, where it is not found.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file if it exists.")] = False,
    quiet: Quiet = False,
) -> None:
    """Convert a recording: sessions, CSV and Parquet into each other."""
    told = RecordingSettings()
    if form is not None:
        told = validated(file_text(form), form, RecordingFile).recording
    with busy("converting", quiet=quiet):
        if estimates:
            count = convert_estimates(source, target, overwrite=force)
        else:
            count = convert_frames(source, target, form=told, overwrite=force)
    say(f"{count} {'estimates' if estimates else 'frames'} written to {target}", quiet=quiet)
