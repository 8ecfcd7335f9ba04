"""softfuse run: live estimates from the sensors of a device."""

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live

from softfuse.cli.interruption import termination_interrupts
from softfuse.cli.live_display import LiveDisplay, besides_samples, latency
from softfuse.cli.live_parts import estimating
from softfuse.cli.live_picture import Pictures, scene_of
from softfuse.cli.sources import connection_of, driver_of, session_info, sources_at
from softfuse.cli.terminal import Charts, Quiet, busy, out_file, stderr, stdout
from softfuse.config import DeviceConfig, load
from softfuse.config.source import AnySource
from softfuse.errors import ConfigError
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.live.rerun_view import LOOPBACK, RerunView
from softfuse.hardware.live.session import Session, SessionReport
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.stream import HostClock

_SHOWN_EVERY_S = 0.2


def run(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    port: Annotated[
        list[str] | None,
        typer.Option(
            help="Port of a device of softfuse's protocol, instead of [\\[source]]; may be repeated."
        ),
    ] = None,
    baud: Annotated[int, typer.Option(help="Baud rate of these ports.", min=50)] = 115200,
    record: Annotated[Path | None, out_file(help="Record everything to this file (.mcap).")] = None,
    view: Annotated[bool, typer.Option("--view", help="Serve the live view to browsers.")] = False,
    save_view: Annotated[Path | None, out_file(help="Save the live view to this file (.rrd).")] = None,
    bind: Annotated[
        str,
        typer.Option(help="Address that the live view listens on; 0.0.0.0 lets every computer look."),
    ] = LOOPBACK,
    view_port: Annotated[int, typer.Option(help="Port of the live view's page.", min=1, max=65535)] = 9090,
    stream_port: Annotated[int, typer.Option(help="Port of the live view's data.", min=1, max=65535)] = 9876,
    seconds: Annotated[
        float | None, typer.Option("--for", help="Stop after so many seconds.", min=0.0)
    ] = None,
    charts: Charts = None,
    quiet: Quiet = False,
) -> None:
    """Estimate location, force and shape live; Ctrl-C ends it."""
    settings = load(config)
    clock = HostClock()
    sources = _sources(settings, port or [], baud)
    with busy("building and compiling", quiet=quiet):
        parts = estimating(settings, charts)
    drivers = [driver_of(source) for source in sources]
    display = LiveDisplay(clock)
    connections: list[Connection] = []
    publish, notify = [display.publish], [display.notify]
    shown: RerunView | None = None
    if view or save_view:
        scene = scene_of(settings, parts.mesh)
        shown = RerunView(
            scene, save=save_view, serve=view, bind=bind, page_port=view_port, stream_port=stream_port
        )
        publish.append(Pictures(shown, parts.device, parts.tracker, parts.readout).publish)
        notify.append(shown.tell)
        if shown.server is not None:
            stdout.print(f"live view: {shown.server.page}", markup=False, highlight=False, soft_wrap=True)
    session = Session(
        Pipeline(parts.channels, drivers),
        parts.follower,
        clock,
        send=lambda source, data: _sent(connections[source], data),
        publish=publish,
        notify=notify,
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
            recorder = None
            if record is not None:
                info = session_info(settings, sources, parts.channels, parts.columns)
                recorder = Recorder(record, info, clock, session.show)
            session.start(recorder)
            _follow(session, display, seconds, quiet=quiet)
    finally:
        for connection in connections:
            connection.stop()
        session.stop()
        if shown is not None:
            shown.close()
    if not quiet:
        _tell(session.report, record)


def _sources(config: DeviceConfig, ports: Sequence[str], baud: int) -> Sequence[AnySource]:
    """Those of the config, or devices at ports; ConfigError without any."""
    if ports:
        return sources_at(ports, baud)
    if not config.sources:
        raise ConfigError(f"{config.path}: source: missing; write a [[source]], or give --port")
    return config.sources


def _sent(connection: Connection, data: bytes) -> None:
    connection.send(data)


def _follow(session: Session, display: LiveDisplay, seconds: float | None, *, quiet: bool) -> None:
    end = None if seconds is None else time.monotonic() + seconds
    with Live(console=stderr, auto_refresh=False, transient=True) as screen:
        while not session.failed and (end is None or time.monotonic() < end):
            time.sleep(_SHOWN_EVERY_S)
            if not quiet and stderr.is_terminal:
                screen.update(display.drawn(session), refresh=True)


def _tell(report: SessionReport, record: Path | None) -> None:
    lines = [
        f"{report.frames} frames, {report.estimated} estimates, {report.overruns} overruns",
        f"latency {latency(report)}" if report.estimated else "nothing was estimated",
    ]
    for device in report.devices:
        lines.append(
            f"source {device.source}, device {device.device}: {device.samples.fresh} samples, "
            f"{device.samples.lost} lost, {device.samples.late} late, {device.samples.duplicated} twice"
        )
    lines += [f"source {k}: {found}" for k, found in enumerate(besides_samples(report)) if found]
    if report.missing:
        lines.append(f"channels that never came: {', '.join(report.missing)}")
    if record is not None:
        lines.append(f"recorded to {record}, {report.recorder_lost} entries lost")
    stdout.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
