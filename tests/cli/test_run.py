"""softfuse run and replay on a coarse pad: a recording sent over a pseudo-terminal, frame by frame."""

import csv
import gzip
import os
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from softfuse.hardware.live.rerun_view import Picture, RerunView
from softfuse.hardware.record.entries import EstimateEntry
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import DescriptionMessage, Header, SampleMessage, encode, pack

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz"
FRAMES, LOST = 330, range(100, 104)
"""Samples that the board takes, and those of them that it never sends."""


@pytest.fixture(scope="module")
def rows() -> list[dict[str, str]]:
    """The beginning of a recording, up to the first force level."""
    with gzip.open(RECORDING, "rt", newline="") as stream:
        return list(csv.DictReader(stream))[:FRAMES]


class Board(threading.Thread):
    """Sends the rows at their own pace to a pseudo-terminal, with its description each second."""

    def __init__(self, rows: list[dict[str, str]]):
        super().__init__(daemon=True)
        self._rows = rows
        self._host, device = os.openpty()
        tty.setraw(device)
        self.port = os.ttyname(device)
        self._device = device
        names = [name for name in rows[0] if name.startswith(("flow", "row", "col"))]
        self._names = names
        channels = tuple(Channel(name, RawType.F64, 1.0, 0.0) for name in names)
        self._description = Description("pad", channels)
        self.begin = threading.Event()

    def run(self) -> None:
        layout = Layout(self._description)
        assert self.begin.wait(300.0)
        began = time.monotonic()
        for k, row in enumerate(self._rows):
            at_us = int(1e6 * float(row["time_s"]))
            time.sleep(max(0.0, began + 1e-6 * at_us - time.monotonic()))
            if k % 100 == 0:
                self._send(DescriptionMessage(Header(0, k, at_us), self._description))
            if k not in LOST:
                content = layout.content(np.array([float(row[name]) for name in self._names]))
                self._send(SampleMessage(Header(0, k, at_us), layout.number, content))

    def _send(self, message: DescriptionMessage | SampleMessage) -> None:
        os.write(self._host, pack(encode(message)))

    def close(self) -> None:
        self.join(60.0)
        os.close(self._device)
        os.close(self._host)


@pytest.fixture(scope="module")
def board(rows: list[dict[str, str]]) -> Iterator[Board]:
    board = Board(rows)
    board.start()
    yield board
    board.close()


@pytest.fixture(scope="module")
def session(
    code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory, coarse: Path, board: Board
) -> Path:
    """What `softfuse run` records of the board."""
    path = tmp_path_factory.mktemp("session") / "s.mcap"

    def begin() -> None:
        # The session's file is there once the port is open and the loop runs.
        while not path.exists():
            time.sleep(0.02)
        time.sleep(0.3)
        board.begin.set()

    threading.Thread(target=begin, daemon=True).start()
    length = 0.01 * FRAMES + 4.0
    assert code_of("run", coarse, "--port", board.port, "--record", path, "--for", length) == 0
    return path


@pytest.fixture(scope="module")
def recorded(session: Path) -> RecordedSession:
    return RecordedSession(session)


def test_every_sample_is_a_frame_with_its_values(
    recorded: RecordedSession, rows: list[dict[str, str]]
) -> None:
    frames = [*recorded.frames()]
    sent = [row for k, row in enumerate(rows) if k not in LOST]
    assert [frame.index for frame in frames] == list(range(len(sent)))
    for frame, row in zip(frames, sent, strict=True):
        expected = [float(row[name]) for name in recorded.info.channels]
        np.testing.assert_array_equal(frame.values, expected)
    times = np.array([frame.time_s for frame in frames])
    true = np.array([float(row["time_s"]) for row in sent])
    np.testing.assert_allclose(times - times[0], true - true[0], atol=0.02)


def test_the_bytes_the_gap_and_the_configuration_are_there(recorded: RecordedSession, coarse: Path) -> None:
    assert recorded.complete and recorded.info.config == coarse.read_bytes()
    assert sum(len(chunk.data) for chunk in recorded.chunks()) > 100 * FRAMES
    told = [notice.text for notice in recorded.notices()]
    assert f"device 0: {len(LOST)} samples lost before sample {LOST.stop}" in told


def test_the_newest_estimates_say_where_and_how_hard(
    recorded: RecordedSession, rows: list[dict[str, str]]
) -> None:
    estimates = [*recorded.estimates()]
    assert len(estimates) > 20
    assert [e.frame for e in estimates] == sorted({e.frame for e in estimates})
    last, true = estimates[-1], rows[-1]
    assert last.frame == FRAMES - len(LOST) - 1 and last.status == ("ok",)
    place = np.array([last.fields["x_mm"], last.fields["y_mm"]], float)
    np.testing.assert_allclose(place, [float(true["true_x_mm"]), float(true["true_y_mm"])], atol=1.0)
    # The coarsest mesh is too stiff by some ten per cent.
    assert last.fields["force_N"] == pytest.approx(float(true["true_force_N"]), rel=0.3)
    assert all(e.end_to_end_ms is not None and e.end_to_end_ms > 0 for e in estimates)


def test_filtered_frames_are_beside_single_ones(
    recorded: RecordedSession, rows: list[dict[str, str]]
) -> None:
    names = [name for name in recorded.info.estimates if name.startswith("filtered_")]
    assert names == [
        *("filtered_x_mm", "filtered_y_mm", "filtered_z_mm", "filtered_force_N"),
        *("filtered_x_sigma_mm", "filtered_y_sigma_mm", "filtered_z_sigma_mm", "filtered_force_sigma_N"),
    ]

    def told(estimate: EstimateEntry) -> list[str]:
        return [name for name in names if estimate.fields.get(name) is not None]

    estimates = [*recorded.estimates()]
    touching = [e for e in estimates if e.fields["contacts"] and e.fields["force_N"] is not None]
    # Where a single frame tells a force they all do, and nowhere else.
    assert len(touching) > 5
    assert [told(e) for e in touching] == [names] * len(touching)
    assert not any(told(e) for e in estimates if not e.fields["contacts"])
    last = estimates[-1]
    single, filtered = (
        np.array([last.fields[prefix + name] for name in ("x_mm", "y_mm", "force_N")], float)
        for prefix in ("", "filtered_")
    )
    np.testing.assert_allclose(filtered, single, atol=0.3)
    assert not np.array_equal(filtered, single)


def test_estimates_are_converted_with_what_frames_say_together(
    code_of: Callable[..., int], tmp_path: Path, session: Path, recorded: RecordedSession
) -> None:
    table = tmp_path / "estimates.csv"
    assert code_of("convert", "--estimates", session, table, "--quiet") == 0
    with table.open(newline="") as stream:
        written = list(csv.DictReader(stream))
    estimates = [*recorded.estimates()]
    assert float(written[-1]["filtered_force_N"]) == estimates[-1].fields["filtered_force_N"]
    # The first frame is one without contact.
    assert written[0]["filtered_force_N"] == written[0]["filtered_x_mm"] == ""


@pytest.mark.parametrize("speed", [(), ("--speed", "4")])
def test_a_replay_gives_the_same_numbers_to_the_last_bit(
    code_of: Callable[..., int],
    session: Path,
    recorded: RecordedSession,
    speed: tuple[str, ...],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert code_of("replay", session, *speed) == 0
    count = len([*recorded.estimates()])
    assert f"{count} of {count} estimates are the recorded ones to the last bit" in capsys.readouterr().out


def test_the_live_view_shows_filtered_frames(
    code_of: Callable[..., int], tmp_path: Path, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Picture] = []
    monkeypatch.setattr(RerunView, "show", lambda self, picture: shown.append(picture))
    assert code_of("replay", session, "--save-view", tmp_path / "v.rrd", "--quiet") == 0
    first, last = shown[0], shown[-1]
    assert "filtered" not in first.status and np.isnan(first.series["force/filtered_force_N"])
    assert first.status == "no contact"
    force, sigma = (last.series[f"force/filtered_force_{what}"] for what in ("N", "sigma_N"))
    assert last.status.startswith(f"ok\nindenter, filtered: {force:.2f} ± {sigma:.2f} N at (")
    assert abs(last.series["model/filtered_x_mm"] - last.series["model/x_mm"]) < 0.3


def test_a_converted_recording_replays_too(
    code_of: Callable[..., int],
    tmp_path: Path,
    session: Path,
    coarse: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    table, again = tmp_path / "s.csv", tmp_path / "again.mcap"
    assert code_of("convert", session, table, "--quiet") == 0
    assert code_of("convert", table, again, "--quiet") == 0
    assert code_of("replay", again, "--quiet") == 2
    assert "holds no configuration: give one with --config" in capsys.readouterr().err
    assert code_of("replay", again, "--config", coarse) == 0
    expected = f"{FRAMES - len(LOST)} estimates; the session holds none to compare with"
    assert expected in capsys.readouterr().out


def test_a_port_that_is_not_there_is_one_line_and_leaves_no_file(
    code_of: Callable[..., int], tmp_path: Path, coarse: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.mcap"
    assert code_of("run", coarse, "--port", str(tmp_path / "nothing"), "--record", path, "--quiet") == 2
    err = capsys.readouterr().err
    assert "there is no such port" in err and "Traceback" not in err and not path.exists()
