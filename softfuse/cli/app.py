"""The command `softfuse` and what all its subcommands share: precision, logs, errors in a line, exit codes.

Exit codes: 0 done, 1 a fault of softfuse itself, 2 a mistake in what the user gave, 130 interrupted.
"""

import logging
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated, NoReturn

import typer
from rich.logging import RichHandler

from softfuse.cli.calibrate import calibrate
from softfuse.cli.convert import convert
from softfuse.cli.design import design
from softfuse.cli.doctor import doctor
from softfuse.cli.estimate import estimate
from softfuse.cli.evaluate import evaluate
from softfuse.cli.mesh import mesh
from softfuse.cli.observe import observe
from softfuse.cli.record_virtual import record_virtual
from softfuse.cli.reduce import reduce
from softfuse.cli.replay import replay
from softfuse.cli.run import run
from softfuse.cli.simulate import simulate
from softfuse.cli.sweep import sweep
from softfuse.cli.terminal import escape_log, say, stderr
from softfuse.cli.testbed import testbed
from softfuse.cli.virtual_device import virtual_device
from softfuse.computing.prepare import prepare_jax
from softfuse.errors import SoftfuseError

app = typer.Typer(
    help="Estimates where, how hard and into what shape a soft robot is being pushed.",
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
)
app.command()(mesh)
app.command()(reduce)
app.command()(simulate)
app.command()(sweep)
app.command()(estimate)
app.command()(calibrate)
app.command()(observe)
app.command()(design)
app.command()(evaluate)
app.command()(run)
app.command()(replay)
app.command()(convert)
app.command()(record_virtual)
app.command()(virtual_device)
app.command()(testbed)
app.command()(doctor)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command of the arguments, by default those of the process, and exit.

    Raises SystemExit with the exit code.
    """
    try:
        app(arguments)
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


@app.callback()
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
