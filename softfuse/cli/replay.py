"""softfuse replay: a recorded session through the same path again."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.live_parts import estimating
from softfuse.cli.live_picture import Pictures, scene_of
from softfuse.cli.sources import driver_of
from softfuse.cli.terminal import Charts, Quiet, busy, out_file, stdout, tracked
from softfuse.config import load
from softfuse.config.file import parse
from softfuse.config.source import AnySource
from softfuse.errors import RecordingError
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.replay import Comparison, Replay
from softfuse.hardware.live.rerun_view import LOOPBACK, RerunView
from softfuse.hardware.record.entries import SourceInfo
from softfuse.hardware.record.session_reader import read_session
from softfuse.hardware.source.driver import AbstractDriver
from softfuse.hardware.source.softfuse_frames import SoftfuseFrames


def replay(
    session: Annotated[Path, typer.Argument(help="Session that softfuse run has recorded (.mcap).")],
    config: Annotated[
        Path | None, typer.Option(help="Configuration to use instead of the one in the session.")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Times the recorded speed; without it as fast as possible.", min=1e-3)
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Serve the live view to browsers.")] = False,
    save_view: Annotated[Path | None, out_file(help="Save the live view to this file (.rrd).")] = None,
    bind: Annotated[str, typer.Option(help="Address that the live view listens on.")] = LOOPBACK,
    view_port: Annotated[int, typer.Option(help="Port of the live view's page.", min=1, max=65535)] = 9090,
    stream_port: Annotated[int, typer.Option(help="Port of the live view's data.", min=1, max=65535)] = 9876,
    charts: Charts = None,
    quiet: Quiet = False,
) -> None:
    """Replay a recorded session, and tell whether its estimates came out the same."""
    recorded = read_session(session)
    if config is not None:
        settings = load(config)
    elif recorded.info.config is not None:
        settings = parse(recorded.info.config.decode(errors="replace"), session.parent / "config.toml")
    else:
        raise RecordingError(f"{session} holds no configuration: give one with --config")
    with busy("building and compiling", quiet=quiet):
        parts = estimating(settings, charts)
    missing = [] if recorded.info.sources else [c for c in parts.channels if c not in recorded.info.channels]
    if missing:
        raise RecordingError(f"{session} lacks the channels {', '.join(missing)} of the configuration")
    pipeline = Pipeline(parts.channels, _drivers(recorded.info.sources, settings.sources))
    again = Replay(recorded, pipeline, parts.follower)
    shown: RerunView | None = None
    pictures: Pictures | None = None
    if view or save_view:
        scene = scene_of(settings, parts.mesh)
        shown = RerunView(
            scene, save=save_view, serve=view, bind=bind, page_port=view_port, stream_port=stream_port
        )
        pictures = Pictures(shown, parts.device, parts.tracker, parts.readout)
        if shown.server is not None:
            stdout.print(f"live view: {shown.server.page}", markup=False, highlight=False, soft_wrap=True)
    count = 0
    estimates = again.run(math.inf if speed is None else speed)
    for published in tracked(estimates, "replaying", total=again.comparison.recorded or None, quiet=quiet):
        count += 1
        if pictures is not None:
            pictures.publish(published)
    if shown is not None:
        shown.close()
    if not quiet:
        stdout.print(_told(again.comparison, count), markup=False, highlight=False, soft_wrap=True)


def _drivers(recorded: Sequence[SourceInfo], configured: Sequence[AnySource]) -> list[AbstractDriver]:
    """A driver for each recorded source; RecordingError where its settings are not known."""
    drivers: list[AbstractDriver] = []
    for k, source in enumerate(recorded):
        if source.driver == "softfuse":
            drivers.append(SoftfuseFrames())
        elif k < len(configured) and configured[k].driver == source.driver:
            drivers.append(driver_of(configured[k]))
        else:
            raise RecordingError(
                f"source {k} of the session has the driver {source.driver!r}, which [[source]] number {k} of "
                "the configuration does not have: give the configuration that it was recorded with"
            )
    return drivers


def _told(comparison: Comparison, count: int) -> str:
    if not comparison.recorded:
        return f"{count} estimates; the session holds none to compare with"
    told = f"{comparison.identical} of {comparison.recorded} estimates are the recorded ones to the last bit"
    return told if comparison.first is None else f"{told}; the first other one is at frame {comparison.first}"
