"""The options of the live view, and the view that they ask for."""

from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import out_file
from softfuse.cli.terminal import say
from softfuse.hardware.live.rerun_view import RerunView
from softfuse.report.live import LiveEstimates

View = Annotated[bool, typer.Option("--view", help="Serve the live view to browsers.")]
SaveView = Annotated[Path | None, out_file(help="Save the live view to this file (.rrd).")]
Bind = Annotated[
    str, typer.Option(help="Address that the live view listens on; 0.0.0.0 lets every computer look.")
]
ViewPort = Annotated[int, typer.Option(help="Port of the live view's page.", min=1, max=65535)]
StreamPort = Annotated[int, typer.Option(help="Port of the live view's data.", min=1, max=65535)]


def opened_view(
    live: LiveEstimates, view: bool, save: Path | None, bind: str, page_port: int, stream_port: int
) -> RerunView | None:
    """The view of these estimates, None where nobody asks for one; says where it is."""
    if not (view or save):
        return None
    shown = RerunView(
        live.scene, save=save, serve=view, bind=bind, page_port=page_port, stream_port=stream_port
    )
    if shown.page is not None:
        say(f"live view: {shown.page}")
    return shown
