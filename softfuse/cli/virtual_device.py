"""softfuse virtual-device: a robot that is not there, on a port of this computer."""

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import platformdirs
import typer

from softfuse.cli.options import Quiet, out_file
from softfuse.cli.progress import busy
from softfuse.cli.terminal import say, termination_interrupts
from softfuse.errors import SoftfuseError
from softfuse.experiment.performance import shown
from softfuse.hardware.stream import HostClock
from softfuse.hardware.virtual.board import BoardClock
from softfuse.hardware.virtual.boards import BoardChannels, TruthFile, boards_of, line_seed
from softfuse.hardware.virtual.faults import HELP, FaultyLine, parse_faults
from softfuse.hardware.virtual.ports import outlets_of
from softfuse.hardware.virtual.serving import VirtualDevice, VirtualPort, as_fast_as_read, in_real_time
from softfuse.robot.file import load

_USUAL_HZ = 100.0
_FASTEST = "max"


def virtual_device(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    tcp: Annotated[
        int | None,
        typer.Option(help="TCP port on loopback (0: any), no pseudo-terminal; a second board has the next."),
    ] = None,
    link: Annotated[
        Path | None,
        typer.Option(help="Symbolic link to the pseudo-terminal; for two boards it is followed by 1 and 2."),
    ] = None,
    rate: Annotated[
        str, typer.Option(help='Samples per second, or "max": of 100 Hz each, as fast as they are read.')
    ] = "100",
    boards: Annotated[
        int, typer.Option(min=1, max=2, help="2: sensors that see contacts, and the rest.")
    ] = 1,
    fault: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help=HELP)] = None,
    seed: Annotated[int, typer.Option(min=0, help="Other zeros, gains, noise and accidents.")] = 0,
    truth: Annotated[Path | None, out_file(help="File for the true values (CSV).")] = None,
    for_s: Annotated[float | None, typer.Option("--for", help="End after so many seconds.")] = None,
    quiet: Quiet = False,
) -> None:
    """Act as the robot: press and drive a virtual one, and send what its sensors say, again and again."""
    settings = load(config)
    rate_Hz = _rate(rate)
    if for_s is not None and not 0 < for_s < math.inf:
        raise SoftfuseError(f"--for {for_s:g}: give how long in seconds")
    outlets = outlets_of(tcp, link, boards)
    faults = parse_faults(fault or [], settings.channels)
    with busy("pressing, once for each configuration", quiet=quiet):
        played = shown(settings, folder=platformdirs.user_cache_path("softfuse") / "virtual")
    programme = played.programme()
    with ExitStack() as stack:
        written = None
        if truth is not None:
            file = TruthFile(truth, programme.truth_at, programme.stepped, HostClock().now_s())
            stack.callback(file.close)
            written = file.write
        parts = [BoardChannels(name, own.channels, own.at, e) for name, own, e in played.boards(boards, seed)]
        made = boards_of(parts, rate_Hz, faults, seed, written)
        ports = [
            VirtualPort(board, FaultyLine(faults.line, line_seed(seed, k)), outlets[k])
            for k, board in enumerate(made)
        ]
        pace = as_fast_as_read if rate == _FASTEST else in_real_time
        device = VirtualDevice(ports, pace, outages=faults.outages, plugged=_tell_ports)
        try:
            with termination_interrupts():
                device.run(for_s)
        finally:
            say(*map(str, ports), quiet=quiet)


def _rate(text: str) -> float:
    if text == _FASTEST:
        return _USUAL_HZ
    try:
        rate_Hz = float(text)
    except ValueError:
        raise SoftfuseError(f'--rate {text}: give samples per second, or "{_FASTEST}"') from None
    return BoardClock(rate_Hz).rate_Hz


def _tell_ports(ports: Sequence[VirtualPort]) -> None:
    """Always told, since nobody could find them otherwise."""
    for port in ports:
        description = port.board.description
        say(f"{description.name}, {len(description.channels)} channels: {' '.join(port.urls)}")
