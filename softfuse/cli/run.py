"""softfuse run: live estimates from the sensors of a device."""

import shlex
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from rich.live import Live

from softfuse.cli.live_display import LiveDisplay, latency
from softfuse.cli.live_parts import Estimating, estimating
from softfuse.cli.live_picture import Pictures, scene_of
from softfuse.cli.sources import connection_of, driver_of
from softfuse.cli.terminal import Quiet, busy, stderr, stdout
from softfuse.config import DeviceConfig, load
from softfuse.config.source import AnySource, SoftfuseSource
from softfuse.errors import ConfigError
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.live.rerun_view import LOOPBACK, RerunView
from softfuse.hardware.live.session import Session, SessionReport
from softfuse.hardware.record.entries import SessionInfo, SourceInfo
from softfuse.hardware.source.connection import Connection
from softfuse.hardware.stream import HostClock

_SHOWN_EVERY_S = 0.2


def run(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    port: Annotated[
        list[str] | None,
        typer.Option(help="Port of a device of softfuse's protocol, instead of [[source]]; may be repeated."),
    ] = None,
    baud: Annotated[int, typer.Option(help="Baud rate of these ports.", min=50)] = 115200,
    record: Annotated[Path | None, typer.Option(help="Record everything to this file (.mcap).")] = None,
    view: Annotated[bool, typer.Option("--view", help="Serve the live view to browsers.")] = False,
    save_view: Annotated[Path | None, typer.Option(help="Save the live view to this file (.rrd).")] = None,
    bind: Annotated[
        str,
        typer.Option(help="Address that the live view listens on; 0.0.0.0 lets every computer look."),
    ] = LOOPBACK,
    view_port: Annotated[int, typer.Option(help="Port of the live view's page.", min=1, max=65535)] = 9090,
    stream_port: Annotated[int, typer.Option(help="Port of the live view's data.", min=1, max=65535)] = 9876,
    seconds: Annotated[
        float | None, typer.Option("--for", help="Stop after so many seconds.", min=0.0)
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Estimate location, force and shape live; Ctrl-C ends it."""
    settings = load(config)
    clock = HostClock()
    sources = _sources(settings, port or [], baud)
    with busy("building and compiling", quiet=quiet):
        parts = estimating(settings)
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
        with _interruptible():
            for connection in connections:
                connection.open()
            # Not before every port is open: a mistake in one leaves no file.
            recorder = (
                None
                if record is None
                else Recorder(record, _info(parts, config, sources), clock, session.show)
            )
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
        return [SoftfuseSource(driver="softfuse", url=url, baud=baud) for url in ports]
    if not config.sources:
        raise ConfigError(f"{config.path}: source: missing; write a [[source]], or give --port")
    return config.sources


def _sent(connection: Connection, data: bytes) -> None:
    connection.send(data)


def _info(parts: Estimating, config: Path, sources: Sequence[AnySource]) -> SessionInfo:
    return SessionInfo(
        device=parts.config.device.name,
        command=shlex.join(["softfuse", *sys.argv[1:]]),
        started=datetime.now(UTC).isoformat(),
        channels=parts.channels,
        estimates=parts.columns,
        sources=tuple(SourceInfo(source.url, source.driver) for source in sources),
        config=config.read_bytes(),
    )


@contextmanager
def _interruptible() -> Iterator[None]:
    """End at Ctrl-C and at a request to terminate, as an orderly stop."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)


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
    if report.missing:
        lines.append(f"channels that never came: {', '.join(report.missing)}")
    if record is not None:
        lines.append(f"recorded to {record}, {report.recorder_lost} entries lost")
    stdout.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)
