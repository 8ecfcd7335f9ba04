"""softfuse testbed against a simulated grbl, force sensor and board, each on a pseudo-terminal."""

import contextlib
import math
import os
import re
import signal
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from softfuse.cli import main
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.recording import Recording, read_recording
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import DescriptionMessage, Header, SampleMessage, encode, pack
from softfuse.robot.file import load

ROOT = Path(__file__).parents[3]
PAD = (ROOT / "configs" / "pad.toml").read_text()
ORIGIN = (5.0, -3.0, -2.0)
WEIGHT = -1.7
"""What the force sensor says without load [N]: the indenter hangs on it."""
QUICK = ("--hold", "0.2", "--rest", "0.1", "--step", "0.5", "--press-speed", "20", "--travel-speed", "100")


class Bed(threading.Thread):
    """A spring under the stage: what a force sensor and a board with the pad's channels say at 100 Hz."""

    def __init__(self, controller) -> None:
        super().__init__(daemon=True)
        self._controller = controller
        self._ports = [os.openpty() for _ in range(2)]
        for _, device in self._ports:
            tty.setraw(device)
        self.urls = [os.ttyname(device) for _, device in self._ports]
        self.top = ORIGIN[2]
        self.stiffness = 4.0
        self.sign = 1.0
        self.quiet_beyond = math.inf
        self.board_starts = -math.inf
        """From when on the board says something [s], on the monotonic clock."""
        self.largest = 0.0
        self.ended = threading.Event()
        names = [name for name in re.findall(r'"((?:flow\d_V|row\d|col\d))"', PAD)]
        self.description = Description("pad", tuple(Channel(n, RawType.F32, 1.0, 0.0) for n in names))

    @property
    def depth(self) -> float:
        """How deep the indenter is [mm]."""
        controller = self._controller
        return max(0.0, self.top - (controller.place[2] - controller.offset[2]))

    def run(self) -> None:
        layout = Layout(self.description)
        began, k = time.monotonic(), 0
        while not self.ended.wait(max(0.0, began + 0.01 * k - time.monotonic())):
            depth, at = self.depth, 10_000 * k
            force = self.stiffness * depth * (1.0 + depth / 5.0)
            self.largest = max(self.largest, force)
            if force < self.quiet_beyond:
                self._send(0, f"{at},{self.sign * force + WEIGHT:.4f}\n".encode())
            k += 1
            if time.monotonic() < self.board_starts:
                continue
            if k % 50 == 1:
                self._send(1, pack(encode(DescriptionMessage(Header(0, k, at), self.description))))
            values = np.full(len(self.description.channels), depth)
            message = SampleMessage(Header(0, k, at), layout.number, layout.content(values))
            self._send(1, pack(encode(message)))

    def _send(self, port: int, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._ports[port][0], data)

    def close(self) -> None:
        self.ended.set()
        self.join()
        for master, device in self._ports:
            os.close(master)
            os.close(device)


@pytest.fixture
def kind() -> str:
    return "grbl"


@pytest.fixture
def bed(controller) -> Iterator[Bed]:
    controller.place = [controller.offset[0], controller.offset[1], controller.offset[2] + 10.0]
    bed = Bed(controller)
    for master, _ in bed._ports:
        os.set_blocking(master, False)
    bed.start()
    yield bed
    bed.close()


@pytest.fixture
def config(bed: Bed, tmp_path: Path) -> Path:
    path = tmp_path / "pad.toml"
    force, board = bed.urls
    path.write_text(
        f'{PAD}\n[[source]]\ndriver = "lines"\nurl = "{force}"\ncolumns = ["time_us", "f"]\n'
        f'time = "time_us"\nchannels = {{ f = "fz_N" }}\n'
        f'[[source]]\ndriver = "softfuse"\nurl = "{board}"\n'
    )
    return path


@pytest.fixture
def run(config: Path, controller, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Runs softfuse testbed with more arguments and returns its exit code."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))

    # A busy machine may keep this process waiting for longer than a stage may go unwatched.
    monkeypatch.setattr("softfuse.hardware.testbed.gathering.STALE_S", 5.0)

    def code(*arguments: object) -> int:
        origin = [f"{value:g}" for value in ORIGIN]
        with pytest.raises(SystemExit) as caught:
            main(
                ["testbed", str(config), "--stage", controller.path, "--origin", *origin]
                + [*QUICK, *map(str, arguments)]
            )
        assert isinstance(caught.value.code, int)
        return caught.value.code

    return code


def sample_frames(recording: Recording) -> np.ndarray:
    """The frames (s,) of a recording that count and in which something presses at a known place."""
    names = ("true_x_mm", "true_y_mm", "true_force_N", "sample")
    known = np.all([np.isfinite(recording.columns[name]) for name in names], axis=0)
    return np.flatnonzero(known & (recording.columns["sample"] > 0) & (recording.columns["true_force_N"] > 0))


def test_places_are_pressed_recorded_and_not_pressed_again(run, bed, controller, config, tmp_path, capsys):
    session, table, places = tmp_path / "s.mcap", tmp_path / "s.csv", tmp_path / "places.csv"
    arguments = ("--out", session, "--out", table, "--places", places, "--force", 3, "--force", 6)
    places.write_text("x_mm,y_mm\n-30,12.5\n")
    assert run(*arguments) == 0
    assert "press 0 at (-30.00, 12.50) mm: " in capsys.readouterr().out

    recording = read_recording(table, load(config).channels)
    columns = recording.columns
    at = sample_frames(recording)
    assert columns["sample"][at].tolist() == [1, 2] and columns["press"][at].tolist() == [0, 0]
    np.testing.assert_allclose(columns["true_x_mm"][at], -30.0, atol=1e-9)
    np.testing.assert_allclose(columns["true_y_mm"][at], 12.5, atol=1e-9)
    np.testing.assert_allclose(columns["true_force_N"][at], [3, 6], atol=1.0)
    # The board reads the true depth, the spring's law gives the force, at the same instant.
    depth = columns["row0"][at]
    np.testing.assert_allclose(columns["true_force_N"][at], 4.0 * depth * (1 + depth / 5), atol=0.02)
    np.testing.assert_allclose(columns["stage_z_mm"][at], ORIGIN[2] - depth, atol=2e-3)
    np.testing.assert_allclose(columns["stage_x_mm"][at], ORIGIN[0] - 30.0, atol=2e-3)
    # At first, nothing is touched; the zero is a mean, and rounded as such.
    assert columns["true_force_N"][0] == pytest.approx(0.0, abs=1e-12)
    assert columns["fz_N"][0] == pytest.approx(WEIGHT, abs=1e-3)
    assert not recording.disordered.any() and bed.largest < 7.5

    recorded = RecordedSession(session)
    assert recorded.complete and recorded.info.channels == tuple(name for name in columns if name != "time_s")
    assert sum(1 for _ in recorded.frames()) == len(recording.time_s)
    assert {chunk.source for chunk in recorded.chunks()} == {0, 1}
    assert sum("level" in notice.text for notice in recorded.notices()) == 2

    # Again, with a second place: only that is pressed, and the stage is left high.
    places.write_text("x_mm,y_mm\n-30,12.5\n30,0\n")
    moves = len(controller.heard)
    assert run(*arguments) == 0
    assert "press 1 at (30.00, 0.00) mm" in capsys.readouterr().out
    assert not any(line.startswith("G1 X-25.") for line in controller.heard[moves:])
    again = read_recording(table, ["press"])
    assert again.columns["sample"][sample_frames(again)].tolist() == [1, 2, 1, 2]
    # After the pause the clock is believed with the third frame.
    late = int(np.argmax(np.diff(again.time_s))) + 1
    assert np.flatnonzero(again.disordered).tolist() == [late, late + 1]
    assert (tmp_path / "s-2.mcap").exists()
    moves = len(controller.heard)
    assert run(*arguments) == 0
    assert "all 2 places are pressed already" in capsys.readouterr().out and len(controller.heard) == moves
    assert bed.depth == 0.0


def test_a_board_that_starts_late_is_waited_for(run, bed, tmp_path):
    # Opening its port resets many a board.
    bed.board_starts = time.monotonic() + 2.0
    assert run("--out", tmp_path / "s.csv", "--grid", 1, 1, "--force", 2) == 0


def test_nothing_moves_without_the_board(run, bed, controller, tmp_path, capsys):
    bed.board_starts = math.inf
    assert run("--out", tmp_path / "s.csv", "--grid", 1, 1, "--force", 2) == 2
    err = capsys.readouterr().err
    assert "row0" in err and "do not come" in err and "nothing has moved" in err and "Traceback" not in err
    assert not controller.heard


def test_a_force_beyond_the_limit_stops_the_stage_on_its_way(run, bed, controller, tmp_path, capsys):
    # The body is higher than said, so that the stage runs into it where it does not feel its way yet.
    bed.stiffness, bed.top = 30.0, ORIGIN[2] + 3.0
    arguments = ("--out", tmp_path / "s.csv", "--grid", 1, 1, "--force", 5, "--force-limit", 8)
    assert run(*arguments, "--travel-speed", 5) == 2
    err = capsys.readouterr().err
    assert "N is beyond the limit of 8 N" in err and "Traceback" not in err
    # At the end of the move that was stopped it would have been 84 N.
    assert controller.halts and 8.0 < bed.largest < 40.0
    assert bed.depth == 0.0


def left_high(bed: Bed, controller) -> bool:
    """Whether the stage is high enough to travel."""
    height = controller.place[2] - controller.offset[2] - ORIGIN[2]
    return bed.depth == 0.0 and height == pytest.approx(5.0, abs=1e-6)


def test_a_force_sensor_that_falls_silent_ends_in_a_retreat_and_one_line(
    run, bed, controller, tmp_path, capsys
):
    bed.quiet_beyond = 2.0
    out = tmp_path / "s.csv"
    assert run("--out", out, "--grid", 1, 1, "--force", 5) == 2
    err = capsys.readouterr().err
    assert "press at (0, 0) mm: fz_N does not come: look at the sensors" in err and "Traceback" not in err
    assert left_high(bed, controller) and bed.largest < 8.0
    # What there was is in the file, and no place counts as done.
    assert len(read_recording(out, ["sample"]).time_s) > 100
    assert len(sample_frames(read_recording(out, []))) == 0


def test_a_termination_lifts_the_stage_first(run, bed, controller, tmp_path):
    def terminate() -> None:
        while bed.largest < 2.0:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=terminate, daemon=True).start()
    out = tmp_path / "s.csv"
    assert run("--out", out, "--grid", 1, 1, "--force", 12) == 130
    assert left_high(bed, controller) and bed.largest < 12.0
    assert len(read_recording(out, ["sample"]).time_s) > 50


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--origin", "nan", 0, 0), "the origin nan 0 0 mm"),
        (("--force-sign", 3), "the force sign 3"),
        (("--force", "nan"), "the force levels nan N"),
        (("--out", "s.csv"), "give each file once"),
        (("--step", 0), "the longest step"),
    ],
)
def test_wrong_options_are_a_line_before_any_port_is_opened(run, controller, capsys, arguments, told):
    assert run("--out", "s.csv", "--dry-run", *arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and told in err and err.count("\n") == 1 and not controller.heard


def test_a_dry_run_says_what_would_move_and_opens_nothing(run, controller, tmp_path, capsys):
    before = len(controller.heard)
    out = tmp_path / "s.mcap"
    assert run("--out", out, "--grid", 2, 2, "--dry-run") == 0
    lines = capsys.readouterr().out.splitlines()
    assert (
        len(lines) == 5 and "4 of 4 places to press, at 5, 10, 15 N; never beyond 19.5 N nor 6 mm" in lines[0]
    )
    assert "press 0 at (-30.00, -30.00) mm: G1 X-25.0000 Y-33.0000 Z3.0000 F6000; tare" in lines[1]
    assert "to Z-8.0000 at most; G1 Z3.0000" in lines[1] and "press 2 at (30.00, 30.00)" in lines[3]
    assert len(controller.heard) == before and not out.exists()
