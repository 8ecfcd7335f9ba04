"""softfuse replay: a recorded session through the same path again."""

import math
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Charts, Quiet
from softfuse.cli.progress import busy, tracked
from softfuse.cli.terminal import say
from softfuse.cli.view_options import Bind, SaveView, StreamPort, View, ViewPort, opened_view
from softfuse.errors import RecordingError
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.replay import Replay
from softfuse.hardware.live.rerun_view import LOOPBACK
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.source.configured import drivers_again
from softfuse.report.live import LiveEstimates, Pictures
from softfuse.robot.file import load, parse


def replay(
    session: Annotated[Path, typer.Argument(help="Session that softfuse run has recorded (.mcap).")],
    config: Annotated[
        Path | None, typer.Option(help="Configuration to use instead of the one in the session.")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Times the recorded speed; without it as fast as possible.", min=1e-3)
    ] = None,
    view: View = False,
    save_view: SaveView = None,
    bind: Bind = LOOPBACK,
    view_port: ViewPort = 9090,
    stream_port: StreamPort = 9876,
    charts: Charts = None,
    quiet: Quiet = False,
) -> None:
    """Replay a recorded session, and tell whether its estimates came out the same."""
    recorded = RecordedSession(session)
    if config is not None:
        settings = load(config)
    elif recorded.info.config is not None:
        settings = parse(recorded.info.config.decode(errors="replace"), session.parent / "config.toml")
    else:
        raise RecordingError(f"{session} holds no configuration: give one with --config")
    with busy("building and compiling", quiet=quiet):
        live = LiveEstimates.built(settings, charts)
    missing = [] if recorded.info.sources else [c for c in live.channels if c not in recorded.info.channels]
    if missing:
        raise RecordingError(f"{session} lacks the channels {', '.join(missing)} of the configuration")
    pipeline = Pipeline(live.channels, drivers_again(recorded.info.sources, settings.sources))
    again = Replay(recorded, pipeline, live)
    shown = opened_view(live, view, save_view, bind, view_port, stream_port)
    pictures = None if shown is None else Pictures(shown, live)
    count = 0
    estimates = again.run(math.inf if speed is None else speed)
    for published in tracked(estimates, "replaying", total=again.comparison.recorded or None, quiet=quiet):
        count += 1
        if pictures is not None:
            pictures.publish(published)
    if shown is not None:
        shown.close()
    say(again.comparison.words(count), quiet=quiet)
