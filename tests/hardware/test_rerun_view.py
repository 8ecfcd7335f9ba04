"""The live view: served on loopback only, drawn in a real browser, never holding anything up."""

import io
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.live.rerun_view import Picture, RerunView, Scene
from softfuse.hardware.live.viewer_process import end_viewer
from softfuse.hardware.stream import Notice
from softfuse.mesh.block import Block, block_mesh
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.report.figures import flat_triangles
from softfuse.report.shape_figures import sharp_edges

BROWSER = (
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--window-size=1300,850",
)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def listened(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
    except OSError:
        return False
    return True


def within(seconds: float, true: Callable[[], bool]) -> bool:
    """Whether it becomes true within so many seconds."""
    deadline = time.monotonic() + seconds
    while not true():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A block with one cavity."""
    low, high = np.array([-0.02, -0.02, 0.0]), np.array([0.02, 0.02, 0.02])
    hole = np.array([[[-0.01, -0.01, 0.005], [0.01, 0.01, 0.012]]])
    block = Block(low, high, hole, np.empty((0, 2, 3)), ((0.0,), (0.0,), (0.02,)))
    mesh = block_mesh(block, 0.005, lambda corners: np.full(len(corners), 0.01))
    faces = outer_surface(mesh).faces
    inside = tuple(flat_triangles(surface.faces) for surface in cavities(mesh))
    return Scene(
        "block", mesh.nodes, flat_triangles(faces), sharp_edges(mesh.nodes, faces), inside, ("hole",)
    )


def picture(scene: Scene, k: int) -> Picture:
    x, y, z = scene.rest_m.T
    sunk = -3e-3 * np.exp(-(x**2 + y**2) / 1e-4) * z / 0.02
    return Picture(
        1.7e9 + 0.1 * k,
        np.stack([0 * x, 0 * x, sunk], axis=1),
        np.array([-1.0]),
        np.array([[0.0, 0.0, 0.02], [np.nan] * 3]),
        np.array([[0.0, 0.0, -4.0], [np.nan] * 3]),
        {"force/force_N": 0.1 * k, "latency/estimate_ms": 2.0},
        np.outer(np.hanning(8), np.hanning(8)),
        "ok",
    )


@pytest.fixture(scope="module")
def served(
    scene: Scene, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[RerunView, Path, int, int]]:
    page, stream = free_port(), free_port()
    path = tmp_path_factory.mktemp("view") / "view.rrd"
    view = RerunView(scene, save=path, page_port=page, stream_port=stream)
    for k in range(30):
        view.show(picture(scene, k))
        time.sleep(0.02)
    view.tell(Notice(1.7e9, None, "warning", "4 samples lost"))
    yield view, path, page, stream
    view.close()


def test_only_this_computer_can_look(served: tuple[RerunView, Path, int, int]) -> None:
    _, _, page, stream = served
    listening = {}
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            if state == "0A":
                address, port = local.split(":")
                listening.setdefault(int(port, 16), set()).add(address)
    assert listening[page] == listening[stream] == {"0100007F"}


@pytest.mark.slow
def test_a_browser_draws_it(served: tuple[RerunView, Path, int, int]) -> None:
    from PIL import Image
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options

    view = served[0]
    assert view.page is not None
    options = Options()
    for argument in BROWSER:
        options.add_argument(argument)
    browser = webdriver.Chrome(options=options)
    try:
        browser.get(view.page)
        deadline, drawn = time.monotonic() + 90.0, np.zeros((1, 1, 3))
        while time.monotonic() < deadline:
            time.sleep(1.0)
            shot = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
            drawn = np.asarray(shot, float)
            red, green, blue = drawn[..., 0], drawn[..., 1], drawn[..., 2]
            # The arrow of the force is red, what has sunk is yellow, the rest of the surface dark violet.
            arrow = np.sum((red > 150) & (green < 90) & (blue < 90))
            if arrow > 100:
                break
        width = drawn.shape[1]
        body = drawn[:, : 3 * width // 5]
        assert arrow > 100, "no arrow has been drawn"
        assert len(np.unique(body.reshape(-1, 3) // 16, axis=0)) > 60, "the body is drawn in many shades"
    finally:
        browser.quit()


def test_the_file_is_written(served: tuple[RerunView, Path, int, int]) -> None:
    _, path, _, _ = served
    deadline = time.monotonic() + 20.0
    while path.stat().st_size < 10_000 and time.monotonic() < deadline:
        time.sleep(0.1)
    assert path.read_bytes()[:4] == b"RRF2" and path.stat().st_size > 10_000


def test_closing_it_ends_the_server(scene: Scene) -> None:
    page = free_port()
    view = RerunView(scene, page_port=page, stream_port=free_port())
    socket.create_connection(("127.0.0.1", page), timeout=5.0).close()
    view.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", page), timeout=5.0)


def test_killed_at_once_it_leaves_no_server() -> None:
    page = free_port()
    code = (
        "import sys, time\n"
        "from softfuse.hardware.live.viewer_process import start_viewer\n"
        "page, stream = sys.argv[1:]\n"
        "where = ['--bind', '127.0.0.1', '--web-viewer-port', page, '--port', stream]\n"
        "start_viewer(['--serve-web', *where])\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(page), str(free_port())]) as program:
        assert within(20.0, lambda: listened(page))
        program.kill()
    assert within(10.0, lambda: not listened(page))


def test_a_group_that_may_not_be_signalled_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """As macOS says of one whose processes have all just ended."""
    asked = []

    def refuse(group: int, number: int) -> None:
        asked.append((group, number))
        raise PermissionError

    monkeypatch.setattr(os, "killpg", refuse)
    code = "import sys; sys.stdin.read()"
    viewer = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, start_new_session=True)
    end_viewer(viewer)
    assert asked == [(viewer.pid, 0)]


def test_a_port_in_use_is_told(scene: Scene) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(HardwareError, match="cannot listen on the ports"):
            RerunView(scene, page_port=taken.getsockname()[1], stream_port=free_port())


def test_nobody_waits_for_a_viewer_that_hangs(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = RerunView(scene, save=tmp_path / "v.rrd", serve=False)
    shown = []

    def hang(self: RerunView, now: Picture) -> None:
        shown.append(now.time_s)
        time.sleep(1.0)

    monkeypatch.setattr(RerunView, "_log_picture", hang)
    began = time.monotonic()
    for k in range(1000):
        view.show(picture(scene, k))
    assert time.monotonic() - began < 1.0
    view.close()
    # The first one or two, and the newest: what came between has been replaced.
    assert len(shown) <= 3 and shown[-1] == picture(scene, 999).time_s
