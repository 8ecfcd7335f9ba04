"""softfuse doctor: what works and what does not, and what to do about it."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from softfuse.cli.options import Quiet
from softfuse.cli.progress import busy
from softfuse.cli.sources import sources_at
from softfuse.cli.terminal import printable, stdout
from softfuse.hardware.doctor.findings import (
    Finding,
    State,
    check_cache,
    check_config,
    check_devices,
    check_installed,
    check_solvers,
    check_viewer,
    well,
)
from softfuse.hardware.doctor.sources import check_ports, check_sources
from softfuse.hardware.source.port import serial_ports

_SIGNS: dict[State, tuple[str, str]] = {
    "ok": ("ok", "green"),
    "note": ("note", "cyan"),
    "problem": ("problem", "red"),
}


def doctor(
    config: Annotated[
        Path | None, typer.Argument(help="Configuration of a robot (TOML), whose sources are listened to.")
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
        settings, told = (None, []) if config is None else check_config(config)
        sources = sources_at(port, baud) if port else () if settings is None else settings.sources
        wanted = () if settings is None else settings.channels
        findings += [*told, *(check_sources(sources, wanted, seconds) if sources else ())]
    if as_json:
        report = {"well": well(findings), "findings": [finding.as_json() for finding in findings]}
        # Escapes all that is not ASCII, hence whatever could command a terminal.
        stdout.file.write(json.dumps(report, indent=1, allow_nan=False) + "\n")
    elif not quiet:
        stdout.print(findings_table(findings))
    if not well(findings):
        raise typer.Exit(2)


def findings_table(findings: Sequence[Finding]) -> Table:
    """As people read them; nothing in it can command a terminal."""
    table = Table.grid(padding=(0, 2))
    for finding in findings:
        word, colour = _SIGNS[finding.state]
        said = f"{finding.said}: {finding.remedy}" if finding.remedy else finding.said
        about, said = (printable(text).replace("\n", " ") for text in (finding.about, said))
        table.add_row(Text(word, style=colour), Text(about), Text(said, overflow="fold"))
    return table
