"""The live picture in Rerun: the deformed body, its forces, its cavities, the electrodes' image, all series.

Whoever shows something leaves it in a mailbox that holds the newest picture only; a thread hands it on. So a
slow viewer, or none at all, never holds anything up: it only sees fewer pictures. The viewer is served by a
process of Rerun's own that listens on the loopback interface alone, unless another address is given.
"""

import subprocess
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from softfuse.errors import HardwareError
from softfuse.hardware.live.viewer_process import end_viewer, start_viewer
from softfuse.hardware.stream import Notice

if TYPE_CHECKING:
    import rerun as rr

LOOPBACK = "127.0.0.1"
MEMORY = "500MB"
"""What the server keeps for viewers that come late."""
_STARTS_WITHIN_S = 15.0
_ARROW_M_N = 5e-3
"""Length of the arrow of a newton [m/N]."""
_PURPLE_TO_YELLOW, _BLUE_TO_RED = "viridis", "coolwarm"


@dataclass(frozen=True, eq=False)
class Scene:
    """What does not change: nodes at rest (n, 3) m, flat triangles of the surface (f, 3) and of each cavity,
    and the edges (e, 2) of the surface that are worth drawing.
    """

    name: str
    rest_m: Float[np.ndarray, "n 3"]
    surface: Int[np.ndarray, "f 3"]
    edges: Int[np.ndarray, "e 2"]
    cavities: tuple[Int[np.ndarray, "g 3"], ...]
    cavity_names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Picture:
    """One moment, `time_s` [s] since the epoch.

    `displacement_m` (n, 3); `cavity` (k,): what colours the cavities, in any unit; `at_m`, `force_N` (c, 3):
    where forces press and their vectors; `series`: by path, such as "force/contact 0 [N]"; `image` (r, s):
    of the electrodes, or None; `status`: in words.
    """

    time_s: float
    displacement_m: Float[np.ndarray, "n 3"]
    cavity: Float[np.ndarray, " k"]
    at_m: Float[np.ndarray, "c 3"]
    force_N: Float[np.ndarray, "c 3"]
    series: Mapping[str, float]
    image: Float[np.ndarray, "r s"] | None
    status: str


class RerunView:
    """Shows pictures to whoever looks, and into a file."""

    def __init__(
        self,
        scene: Scene,
        *,
        save: Path | None = None,
        serve: bool = True,
        bind: str = LOOPBACK,
        page_port: int = 9090,
        stream_port: int = 9876,
    ):
        """Start the server, if it is to serve, and a thread.

        `save`: an .rrd file to be written as well; `bind`: the address to listen on. Raises HardwareError
        without Rerun, or when the server does not start.
        """
        rr = _rerun()
        self._scene = scene
        self._server: subprocess.Popen[bytes] | None = None
        self.page: str | None = None
        """Where a browser finds it, if it is served."""
        self._stream = rr.RecordingStream(f"softfuse {scene.name}")
        served = []
        if serve:
            self.page, stream, self._server = _serve(bind, page_port, stream_port)
            served = [rr.GrpcSink(stream)]
        saved = [rr.FileSink(str(save))] if save else []
        self._stream.set_sinks(*served, *saved, default_blueprint=_blueprint())
        self._log_scene()
        self._newest: Picture | None = None
        self._notices: list[Notice] = []
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="softfuse view", daemon=True)
        self._thread.start()

    def show(self, picture: Picture) -> None:
        """Leave a picture to be shown, in place of one that has not been yet; never blocks."""
        with self._changed:
            self._newest = picture
            self._changed.notify()

    def tell(self, notice: Notice) -> None:
        """Leave a notice to be shown; the oldest of many that wait goes."""
        with self._changed:
            self._notices = [*self._notices[-99:], notice]
            self._changed.notify()

    def close(self) -> None:
        """Show what waits, and end the server."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(5.0)
        if not self._thread.is_alive():
            self._stream.flush(timeout_sec=5.0)
            self._stream.disconnect()
        if self._server is not None:
            end_viewer(self._server)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest or self._notices or self._closed)
                picture, self._newest = self._newest, None
                notices, self._notices = self._notices, []
                closed = self._closed
            for notice in notices:
                self._log_notice(notice)
            if picture is not None:
                self._log_picture(picture)
            if closed and picture is None and not notices:
                return

    def _log_scene(self) -> None:
        rr = _rerun()
        self._stream.log("body", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rest = 1e3 * self._scene.rest_m[self._scene.edges]
        lines = rr.LineStrips3D(list(rest.astype(np.float32)), radii=0.1, colors=(150, 150, 150))
        self._stream.log("body/rest", lines, static=True)

    def _log_notice(self, notice: Notice) -> None:
        rr = _rerun()
        level = {"info": "INFO", "warning": "WARN", "error": "ERROR"}[notice.level]
        self._stream.set_time("time", timestamp=notice.host_s)
        self._stream.log("notices", rr.TextLog(notice.text, level=level))

    def _log_picture(self, picture: Picture) -> None:
        rr, scene, stream = _rerun(), self._scene, self._stream
        stream.set_time("time", timestamp=picture.time_s)
        now = 1e3 * (scene.rest_m + picture.displacement_m)
        moved = 1e3 * np.linalg.norm(picture.displacement_m, axis=1)
        _log_mesh(
            stream,
            "body/surface",
            now,
            scene.surface,
            _coloured(moved / max(moved.max(), 1e-3), _PURPLE_TO_YELLOW),
            150,
        )
        largest = max(float(np.nanmax(np.abs(picture.cavity), initial=0.0)), 1e-30)
        for name, faces, value in zip(scene.cavity_names, scene.cavities, picture.cavity, strict=True):
            colour = _coloured(0.5 + 0.5 * value / largest, _BLUE_TO_RED)
            _log_mesh(stream, f"body/cavities/{name}", now, faces, np.tile(colour, (len(now), 1)), 255)
        known = np.isfinite(picture.at_m).all(axis=1) & np.isfinite(picture.force_N).all(axis=1)
        vectors = 1e3 * _ARROW_M_N * picture.force_N[known]
        sizes = np.linalg.norm(picture.force_N[known], axis=1)
        stream.log(
            "body/forces",
            rr.Arrows3D(
                origins=1e3 * picture.at_m[known] - vectors,
                vectors=vectors,
                labels=[f"{size:.2f} N" for size in sizes],
                show_labels=True,
                colors=(220, 40, 40),
                radii=0.6,
            ),
        )
        for path, value in picture.series.items():
            if np.isfinite(value):
                stream.log(path.replace(" ", "_"), rr.Scalars(value))
        if picture.image is not None:
            peak = max(float(np.nanmax(picture.image)), 1e-30)
            stream.log("electrodes", rr.Image(_coloured(picture.image / peak, _PURPLE_TO_YELLOW)))
        stream.log("status", rr.TextDocument(picture.status))


def _rerun():
    try:
        import rerun
    except ImportError as error:
        raise HardwareError("the live view needs Rerun: pip install 'softfuse[viz]'") from error
    return rerun


def _blueprint() -> "rr.blueprint.Blueprint":
    from rerun import blueprint as rrb

    series = rrb.Vertical(
        rrb.TimeSeriesView(origin="force", name="forces"),
        rrb.TimeSeriesView(origin="model", name="measured and modelled"),
        rrb.TimeSeriesView(origin="channels", name="channels"),
        rrb.TimeSeriesView(origin="latency", name="latency"),
    )
    body = rrb.Vertical(
        rrb.Spatial3DView(origin="body", name="body [mm]"),
        rrb.Horizontal(
            rrb.TextDocumentView(origin="status", name="status"),
            rrb.Spatial2DView(origin="electrodes", name="electrodes"),
            rrb.TextLogView(origin="notices", name="notices"),
        ),
        row_shares=(3, 1),
    )
    return rrb.Blueprint(rrb.Horizontal(body, series, column_shares=(3, 2)), collapse_panels=True)


def _serve(bind: str, page_port: int, stream_port: int) -> tuple[str, str, "subprocess.Popen[bytes]"]:
    """Start Rerun's server, which listens on one address only: where a browser finds the viewer, where one
    that is installed finds the data, and the server.
    """
    busy = f"the live view cannot listen on the ports {page_port} and {stream_port} of {bind}"
    shown = LOOPBACK if bind in ("0.0.0.0", "::") else bind
    if _listens(shown, page_port) or _listens(shown, stream_port):
        raise HardwareError(f"{busy}: another program does, such as another live view; choose other ports")
    ports = ["--port", str(stream_port), "--web-viewer-port", str(page_port)]
    process = start_viewer(["--serve-web", "--bind", bind, *ports, "--server-memory-limit", MEMORY])
    stream = f"rerun+http://{shown}:{stream_port}/proxy"
    deadline = time.monotonic() + _STARTS_WITHIN_S
    while not (_listens(shown, page_port) and _listens(shown, stream_port)):
        if process.poll() is not None or time.monotonic() > deadline:
            end_viewer(process)
            raise HardwareError(f"{busy}: is the address one of this computer's?")
        time.sleep(0.05)
    return f"http://{shown}:{page_port}/?url={stream.replace('+', '%2B')}", stream, process


def _listens(address: str, port: int) -> bool:
    import socket

    try:
        socket.create_connection((address, port), timeout=0.5).close()
    except OSError:
        return False
    return True


def _coloured(shares: np.ndarray, palette: str) -> np.ndarray:
    """Colours (..., 3) of numbers between 0 and 1."""
    from matplotlib import colormaps

    return (255 * np.array(colormaps[palette](np.clip(shares, 0, 1)))[..., :3]).astype(np.uint8)


def _log_mesh(stream, path: str, nodes, faces, colours, opacity: int) -> None:
    import rerun as rr

    used, corners = np.unique(faces, return_inverse=True)
    stream.log(
        path,
        rr.Mesh3D(
            vertex_positions=nodes[used],
            triangle_indices=corners.reshape(faces.shape),
            vertex_colors=colours[used],
            albedo_factor=(255, 255, 255, opacity),
        ),
    )
