"""softfuse run: live estimates from the sensors of a robot."""

import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live

from softfuse.cli.live_display import LiveDisplay
from softfuse.cli.options import Charts, Quiet, out_file
from softfuse.cli.progress import busy
from softfuse.cli.sources import session_info, sources_of
from softfuse.cli.terminal import say, stderr, termination_interrupts
from softfuse.cli.view_options import Bind, SaveView, StreamPort, View, ViewPort, opened_view
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.live.rerun_view import LOOPBACK
from softfuse.hardware.live.session import Session, told
from softfuse.hardware.source.configured import connection_of, driver_of
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.stream import HostClock
from softfuse.report.live import LiveEstimates, Pictures
from softfuse.robot.file import load

_SHOWN_EVERY_S = 0.2


def run(
    config: Annotated[Path, typer.Argument(help="Configuration of the robot (TOML).")],
    port: Annotated[
        list[str] | None,
        typer.Option(help="Port of a board of softfuse's protocol, instead of [\\[source]]; repeatable."),
    ] = None,
    baud: Annotated[int, typer.Option(help="Baud rate of these ports.", min=50)] = 115200,
    record: Annotated[Path | None, out_file(help="Record everything to this file (.mcap).")] = None,
    view: View = False,
    save_view: SaveView = None,
    bind: Bind = LOOPBACK,
    view_port: ViewPort = 9090,
    stream_port: StreamPort = 9876,
    seconds: Annotated[
        float | None, typer.Option("--for", help="Stop after so many seconds.", min=0.0)
    ] = None,
    charts: Charts = None,
    quiet: Quiet = False,
) -> None:
    """Estimate contacts, forces and shape live; Ctrl-C ends it."""
    settings, clock = load(config), HostClock()
    sources = sources_of(settings, port or [], baud)
    with busy("building and compiling", quiet=quiet):
        live = LiveEstimates.built(settings, charts)
    drivers = [driver_of(source) for source in sources]
    display, connections = LiveDisplay(clock, live.columns.slots), list[Connection]()
    shown = opened_view(live, view, save_view, bind, view_port, stream_port)
    session = Session(
        Pipeline(live.channels, drivers),
        live,
        clock,
        send=lambda source, data: connections[source].send(data),
        publish=[display.publish, *([] if shown is None else [Pictures(shown, live).publish])],
        notify=[display.notify, *([] if shown is None else [shown.tell])],
    )
    connections += [
        connection_of(k, source, driver, session.receive, session.tell, clock)
        for k, (source, driver) in enumerate(zip(sources, drivers, strict=True))
    ]
    try:
        with suppress(KeyboardInterrupt), termination_interrupts():
            for connection in connections:
                connection.open()
            # Not before every port is open: a mistake in one leaves no file.
            info = session_info(settings, sources, live.channels, live.kinds)
            session.start(None if record is None else Recorder(record, info, clock, session.show))
            _follow(session, display, seconds, quiet=quiet)
    finally:
        for connection in connections:
            connection.stop()
        session.stop()
        if shown is not None:
            shown.close()
    lost = session.report.recorder_lost
    kept = [] if record is None else [f"recorded to {record}, {lost} entries lost"]
    say(*told(session.report), *kept, quiet=quiet)


def _follow(session: Session, display: LiveDisplay, seconds: float | None, *, quiet: bool) -> None:
    end = None if seconds is None else time.monotonic() + seconds
    with Live(console=stderr, auto_refresh=False, transient=True) as screen:
        while not session.failed and (end is None or time.monotonic() < end):
            time.sleep(_SHOWN_EVERY_S)
            if not quiet and stderr.is_terminal:
                screen.update(display.drawn(session), refresh=True)
