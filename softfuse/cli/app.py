"""The command `softfuse` and what all its subcommands share: precision, logs, errors in a line, exit codes.

Exit codes: 0 done, 1 a fault of softfuse itself, 2 a mistake in what the user gave, 130 interrupted.
"""

import logging
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, NoReturn

import typer
from rich.logging import RichHandler

from softfuse.cli.terminal import escape_log, say, stderr
from softfuse.computing.prepare import prepare_jax
from softfuse.errors import SoftfuseError

_COMMANDS = (
    "mesh",
    "reduce",
    "simulate",
    "sweep",
    "estimate",
    "calibrate",
    "observe",
    "design",
    "evaluate",
    "run",
    "replay",
    "convert",
    "record-virtual",
    "virtual-device",
    "testbed",
    "doctor",
)
"""Each a function of a module of its own here, called like it."""


def app_for(arguments: Sequence[str]) -> typer.Typer:
    """With the one command that the arguments name, as what the others need takes seconds to import; with all
    where they name none.
    """
    app = typer.Typer(
        help="Estimates where, how hard and into what shape a soft robot is being pushed.",
        no_args_is_help=True,
        pretty_exceptions_show_locals=False,
    )
    app.callback()(_prepare)
    named = [name for name in _COMMANDS if name in arguments[:1]]
    for name in named or _COMMANDS:
        called = name.replace("-", "_")
        app.command(name)(getattr(import_module(f"softfuse.cli.{called}"), called))
    return app


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command of the arguments, by default those of the process, and exit.

    Raises SystemExit with the exit code.
    """
    try:
        given = sys.argv[1:] if arguments is None else list(arguments)
        app_for(given)(given)
    except SoftfuseError as error:
        _tell(str(error))
    except OSError as error:
        # What could not be read or written and was not foreseen: a disk that is full, a folder that has gone.
        _tell(f"{error.filename or 'a file'} cannot be read or written: {error.strerror or error}")


def _tell(told: str) -> NoReturn:
    say(*(f"error: {line}" for line in told.split("\n")), console=stderr)
    raise SystemExit(2) from None


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"softfuse {version('softfuse')}")
        raise typer.Exit


def _prepare(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    handler = RichHandler(console=stderr, show_time=False, show_path=False, markup=False)
    handler.addFilter(escape_log)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    prepare_jax()
