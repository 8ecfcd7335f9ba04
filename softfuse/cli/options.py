"""Options that several commands share."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from softfuse.errors import SoftfuseError

Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress and no tables, only errors.")]
"""The option --quiet of every command."""


def _writable_file(path: Path | None) -> Path | None:
    """The path of a file that a command will write, checked before its work: SoftfuseError."""
    if path is None:
        return path
    if path.is_dir():
        raise SoftfuseError(f"{path} cannot be written: it is a folder, give a file")
    if not path.parent.is_dir():
        raise SoftfuseError(f"{path} cannot be written: there is no folder {path.parent}")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise SoftfuseError(f"{path} cannot be written: no permission, choose another place")
    return path


def _writable_folder(path: Path) -> Path:
    """The path of a folder that a command will make or write in, checked before its work: SoftfuseError."""
    there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not there.is_dir():
        raise SoftfuseError(f"{path} cannot be written: {there} is a file, give a folder")
    if not os.access(there, os.W_OK):
        raise SoftfuseError(f"{path} cannot be written: no permission in {there}, choose another place")
    return path


def out_file(*names: str, help: str) -> Any:
    """An option for a file to write."""
    return typer.Option(*names, help=help, callback=_writable_file)


def out_folder(help: str) -> Any:
    """An option for a folder to write in."""
    return typer.Option(help=help, callback=_writable_folder)


Charts = Annotated[
    Path | None,
    typer.Option(
        "--charts", help="Estimate in real time, with the charts that softfuse reduce has put there."
    ),
]
"""The option --charts of commands that estimate."""
