"""softfuse doctor: what works and what does not, and what to do about it."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.doctor_computing import check_cache, check_devices, check_solvers, check_viewer
from softfuse.cli.doctor_installed import check_installed
from softfuse.cli.doctor_sources import check_ports, check_sources
from softfuse.cli.finding import Finding, findings_table, well
from softfuse.cli.sources import sources_at
from softfuse.cli.terminal import Quiet, busy, stdout
from softfuse.errors import ConfigError
from softfuse.hardware.source.serial_ports import serial_ports
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings


def doctor(
    config: Annotated[
        Path | None, typer.Argument(help="Configuration of a device (TOML), whose sources are listened to.")
    ] = None,
    port: Annotated[
        list[str] | None,
        typer.Option(help="Port of a device of softfuse's protocol to listen to; may be repeated."),
    ] = None,
    baud: Annotated[int, typer.Option(help="Baud rate of these ports.", min=50)] = 115200,
    seconds: Annotated[
        float, typer.Option("--for", help="How long to listen, in s.", min=0.1, max=600.0)
    ] = 2.0,
    as_json: Annotated[bool, typer.Option("--json", help="Tell machines instead of people.")] = False,
    quiet: Quiet = False,
) -> None:
    """Tell what is installed, what computes, and which ports answer; opens no port unless asked.

    Exit code 0 when all is well, 2 when something is not.
    """
    with busy("looking", quiet=quiet or as_json):
        findings = [*check_installed(), *check_devices(), *check_solvers(), check_cache(), check_viewer()]
        findings += check_ports(serial_ports())
        settings, told = _read(config)
        findings += told
        sources = sources_at(port, baud) if port else () if settings is None else settings.sources
        if sources:
            findings += check_sources(sources, _wanted(settings), seconds)
    if as_json:
        report = {"well": well(findings), "findings": [finding.as_json() for finding in findings]}
        # Escapes all that is not ASCII, hence whatever could command a terminal.
        stdout.file.write(json.dumps(report, indent=1, allow_nan=False) + "\n")
    elif not quiet:
        stdout.print(findings_table(findings))
    if not well(findings):
        raise typer.Exit(2)


def _read(config: Path | None) -> tuple[RobotSettings | None, list[Finding]]:
    """The configuration, and what is wrong with it."""
    if config is None:
        return None, []
    try:
        settings = load(config)
    except ConfigError as error:
        lines = str(error).split("\n")
        return None, [
            Finding(str(config), "problem", line.removeprefix(f"{config}: "), "correct the file, or its name")
            for line in lines
        ]
    if not settings.sensors:
        return settings, [Finding(str(config), "note", "it has no [sensors]", "add them for live estimates")]
    heard = "" if settings.sources else "; it has no [[source]], --port listens to a device"
    return settings, [Finding(str(config), "ok", f"{settings.robot.name}{heard}")]


def _wanted(config: RobotSettings | None) -> Sequence[str]:
    return () if config is None else config.channels
