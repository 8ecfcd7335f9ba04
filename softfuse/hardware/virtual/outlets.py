"""The ports on which virtual boards are found, and what these say of themselves in the end."""

from pathlib import Path

from softfuse.hardware.virtual.outlet import AbstractOutlet
from softfuse.hardware.virtual.pseudo_terminal import PseudoTerminal
from softfuse.hardware.virtual.serving import VirtualPort
from softfuse.hardware.virtual.tcp_port import TcpPort


def outlets_of(tcp: int | None, link: Path | None, boards: int) -> list[list[AbstractOutlet]]:
    """The outlets of each board: a pseudo-terminal unless there is a TCP port and no link is asked for."""
    found: list[list[AbstractOutlet]] = []
    for k in range(boards):
        here: list[AbstractOutlet] = []
        if tcp is not None:
            here.append(TcpPort(tcp + k if tcp else 0))
        if link is not None:
            here.append(PseudoTerminal(link if boards == 1 else link.with_name(f"{link.name}{k + 1}")))
        elif tcp is None:
            here.append(PseudoTerminal())
        found.append(here)
    return found


def said_of(port: VirtualPort) -> str:
    """What a port has done, for people."""
    report = port.report
    board = report.board
    parts = [f"{board.samples} samples", f"{report.sent} packets heard", f"{report.unheard} not"]
    parts += [
        f"{count} {what}"
        for count, what in (
            (board.lost, "samples lost"),
            (report.dropped_bytes, "bytes dropped"),
            (report.flipped_bits, "bits flipped"),
            (report.outages, "times away"),
        )
        if count
    ]
    return f"{port.board.description.name}: {', '.join(parts)}"
