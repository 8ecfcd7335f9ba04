"""softfuse virtual-device: from a configuration to frames on a port, with a body that is made up here."""

import csv
import os
import signal
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import serial

from softfuse.experiment import equilibria, performance
from softfuse.experiment.episodes import Episode
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot
from softfuse.hardware.wire.decoder import Decoder
from softfuse.hardware.wire.message import EVERY_DEVICE, AskMessage, Header, SampleMessage, encode
from softfuse.hardware.wire.packet import pack
from softfuse.robot.file import parse
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.crossed.settings import CrossedSettings
from softfuse.sensors.parts import TrueContact

CONFIGS = Path(__file__).parents[2] / "configs"
ASK = pack(encode(AskMessage(Header(EVERY_DEVICE, 0, 0))))
FLOWS = [f"flow{k}_V" for k in range(4)]
LINES = [f"{side}{k}" for side in ("row", "col") for k in range(8)]
CELLS = [f"cell{row}{column}" for row in range(4) for column in range(4)]
COARSE = (
    ('surface_size = "12 mm"', 'surface_size = "30 mm"'),
    ('base_size = "12 mm"', 'base_size = "40 mm"'),
    ("growth = 0.5", "growth = 9.0"),
    ('wall_size = "10 mm"', 'wall_size = "20 mm"'),
    ('base_size = "8 mm"', 'base_size = "30 mm"'),
    ("growth = 2.0", "growth = 9.0"),
    ('"taylor-hood"', '"linear"'),
)


def made_up_robot(drawn: RobotSettings, errors: MakingErrors) -> VirtualRobot:
    """The robot as drawn, on a coarse mesh, once for each config."""
    return VirtualRobot(drawn, errors, _robot(drawn.path))


@cache
def _robot(path: Path):
    text = path.read_text(encoding="utf-8")
    for old, new in COARSE:
        text = text.replace(old, new)
    return build_robot(parse(text, path))


class MadeUpSolver:
    """Bends and gives way in proportion, and sees what lies on the body at rest."""

    def __init__(self, robot: VirtualRobot) -> None:
        self._made = robot.made

    def reach(self) -> tuple[tuple[str, float], ...]:
        return tuple((cable.name, 10e-3) for cable in self._made.settings.cables)

    def poses(self, episode: Episode, *, solved=None) -> dict[str, np.ndarray]:
        del solved
        gaps = np.array(equilibria._GAPS_M)
        (touch, *_) = episode.touches
        force = np.array([*(0.0 * gaps), *touch.forces])
        gap = np.array([*gaps, *(-1e-4 * np.array(touch.forces))])
        n, made = len(force), self._made
        slots, readings, drives = len(made.workspaces), made.model.n_readings, len(made.addresses.drives)
        poses = {
            "reading": np.outer(force, np.full(readings, -1e-8)),
            "force": np.concatenate([force[:, None], np.zeros((n, slots - 1))], axis=1),
            "gap": np.concatenate([gap[:, None], np.full((n, slots - 1), gaps[0])], axis=1),
            "point": np.zeros((n, len(made.settings.points), 3)),
            "drive": np.zeros((n, drives)),
            "answer": np.zeros((n, drives)),
            "volume": np.outer(force, np.full(len(made.settings.chambers), -1e-8)),
            "held": (force > 0).astype(float),
        }
        for sensor in made.settings.sensors:
            if sensor.name in {each.name for each in made.suite.contact_sensors}:
                seen = [self._seen(sensor, touch, *each) for each in zip(gap, force, strict=True)]
                poses[f"signal {sensor.name}"] = np.stack(seen)
        return poses

    def _seen(self, sensor, touch, gap: float, force: float) -> np.ndarray:
        place = np.array(touch.place)
        if isinstance(sensor, CrossedSettings):
            apart = np.concatenate(
                [np.array(sensor.row_y) - place[0, 1], np.array(sensor.column_x) - place[0, 0]]
            )
            return 2e-12 * np.exp(-((apart / 10e-3) ** 2)) * np.exp(-max(gap, 0.0) / 2e-3)
        normal = np.cross(place[1], place[2])
        middle = place[0] + (8e-3 + max(gap, 0.0)) * normal
        there = TrueContact(place, gap, force, middle=middle)
        return sensor.signal(self._made.parts, [there], sensor.points(self._made.parts))


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is solved."""
    monkeypatch.setattr(performance, "virtual_robot", made_up_robot)
    monkeypatch.setattr(performance, "RobotSolver", MadeUpSolver)
    monkeypatch.setattr(equilibria, "RobotSolver", MadeUpSolver)


class Listener(threading.Thread):
    """Reads a port once it is there until it goes away."""

    def __init__(self, url: Path | str) -> None:
        super().__init__(daemon=True)
        self._url = str(url)
        self.decoder = Decoder()
        self.samples: list[tuple[int, int, int, np.ndarray | None]] = []
        self.start()

    def run(self) -> None:
        while self._url.startswith("/") and not os.path.exists(self._url):
            time.sleep(0.005)
        with serial.serial_for_url(self._url, timeout=0.1) as stream:
            stream.write(ASK)
            try:
                while True:
                    for one in self.decoder.feed(stream.read(512), 0.0):
                        if isinstance(one.message, SampleMessage):
                            header = one.message.header
                            self.samples.append((header.device, header.sequence, header.time_us, one.values))
            except (serial.SerialException, OSError):
                pass

    def values(self) -> np.ndarray:
        self.join(10)
        return np.array([values for *_, values in self.samples if values is not None])


def test_a_pad_sends_the_channels_of_its_configuration(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link, truth = tmp_path / "pad", tmp_path / "truth.csv"
    listener = Listener(link)
    assert (
        code_of("virtual-device", CONFIGS / "pad.toml", "--link", link, "--for", "1.5", "--truth", truth) == 0
    )
    values = listener.values()
    (description,) = listener.decoder.descriptions.values()
    assert list(description.names) == FLOWS + LINES and description.name == "Soft Pad"
    assert values.shape[1] == 20 and len(values) > 80
    # At rest: zeros of the flow sensors, parasitic counts, all on the codes of the converter.
    np.testing.assert_allclose(values[:, :4].mean(axis=0), 0.5, atol=0.01)
    assert (np.abs(values[:, 4:].mean(axis=0) - 20_000) < 600).all()
    codes = values[:, :4] / np.float32(3.3 / 4096)
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-6)
    assert 1.5e-3 < values[:, :4].std(axis=0).mean() < 2.5e-3
    out = capsys.readouterr().out
    assert str(link) in out and "20 channels" in out and "samples" in out
    with truth.open() as stream:
        rows = list(csv.DictReader(stream))
    names = ["time_s", "press", "sample", "true_x_mm", "true_y_mm", "true_z_mm", "true_force_N"]
    assert list(rows[0])[:7] == names
    times = np.array([float(row["time_s"]) for row in rows])
    assert abs(times[-1] - time.time()) < 10 and len(times) == pytest.approx(150, abs=30)
    np.testing.assert_allclose(np.diff(times), 0.01, atol=2e-6)


def test_a_pad_with_a_grid_sends_the_channels_of_its_configuration(
    code_of: Callable[..., int], tmp_path: Path
) -> None:
    link = tmp_path / "pad"
    listener = Listener(link)
    assert code_of("virtual-device", CONFIGS / "pad_mutual.toml", "--link", link, "--for", "1") == 0
    values = listener.values()
    (description,) = listener.decoder.descriptions.values()
    assert list(description.names) == FLOWS + CELLS and description.name == "Soft Pad with Grid"
    np.testing.assert_allclose(values[:, :4].mean(axis=0), 0.5, atol=0.01)
    # At rest a cell reads 16 000, up to its part of 1500 and a wander.
    assert (np.abs(values[:, 4:].mean(axis=0) - 16_000) < 1500 + 300).all()
    assert np.ptp(values[:, 4:].mean(axis=0)) > 500
    assert (values[:, 4:] == np.rint(values[:, 4:])).all()
    assert 6 < values[:, 4:].std(axis=0).mean() < 12


def test_a_grids_counts_drop_when_the_punch_is_near_and_rise_under_its_force(
    code_of: Callable[..., int], tmp_path: Path
) -> None:
    link, truth = tmp_path / "pad", tmp_path / "truth.csv"
    listener = Listener(link)
    arguments = ["--link", link, "--rate", "max", "--for", "6", "--truth", truth]
    assert code_of("virtual-device", CONFIGS / "pad_mutual.toml", *arguments) == 0
    cells = listener.values()[:, 4:].reshape(-1, 4, 4)
    with truth.open() as stream:
        rows = list(csv.DictReader(stream))
    sequence = np.array([number for _, number, *_ in listener.samples])[-len(cells) :]

    def true(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in rows])[sequence]

    names = ("true_finger0_force_N", "true_depth_mm", "press")
    force, depth, press = (true(name) for name in names)
    lines_mm = np.array([-24.0, -8.0, 8.0, 24.0])
    for number in range(2):
        here = press == number
        far, low = here & (depth < -59.0), here & (depth > -0.3) & (depth <= 0.0) & (force < 0.05)
        firm = here & (force > 0.99 * force[here].max())
        assert min(far.sum(), low.sum(), firm.sum()) > 5
        row = np.argmin(np.abs(lines_mm - np.median(true("true_finger0_y_mm")[firm])))
        column = np.argmin(np.abs(lines_mm - np.median(true("true_finger0_x_mm")[firm])))
        rest, light, hard = (cells[which].mean(axis=0) for which in (far, low, firm))
        drop, rise = light - rest, hard - rest
        assert drop.min() == drop[row, column] < -500
        assert rise.max() == rise[row, column] > 500
        assert (drop < 50).all()


def test_two_boards_of_a_pad_with_a_grid_have_the_cells_first(
    code_of: Callable[..., int], tmp_path: Path
) -> None:
    listeners = [Listener(tmp_path / f"pad{k}") for k in (1, 2)]
    arguments = ["--link", tmp_path / "pad", "--boards", "2", "--for", "0.5"]
    assert code_of("virtual-device", CONFIGS / "pad_mutual.toml", *arguments) == 0
    names = []
    for listener in listeners:
        assert listener.values().size
        (description,) = listener.decoder.descriptions.values()
        names.append(list(description.names))
    assert names == [CELLS, FLOWS]


def test_two_boards_share_the_channels(code_of: Callable[..., int], tmp_path: Path) -> None:
    listeners = [Listener(tmp_path / f"pad{k}") for k in (1, 2)]
    assert (
        code_of(
            "virtual-device", CONFIGS / "pad.toml", "--link", tmp_path / "pad", "--boards", "2", "--for", "1"
        )
        == 0
    )
    names = []
    for number, listener in enumerate(listeners, start=1):
        assert listener.values().size
        assert {device for device, *_ in listener.samples} == {number}
        (description,) = listener.decoder.descriptions.values()
        names.append(list(description.names))
    assert names == [LINES, FLOWS]
    # Each has a clock of its own.
    starts = [listener.samples[0][2] - 10_000 * listener.samples[0][1] for listener in listeners]
    assert starts[0] != starts[1]


def test_a_finger_sends_the_channels_of_its_configuration(
    code_of: Callable[..., int], tmp_path: Path
) -> None:
    link = tmp_path / "finger"
    listener = Listener(link)
    assert code_of("virtual-device", CONFIGS / "finger.toml", "--link", link, "--for", "1", "--quiet") == 0
    values = listener.values()
    (description,) = listener.decoder.descriptions.values()
    assert list(description.names) == [
        *(f"pressure{k}_V" for k in range(6)), *(f"electrode{k}" for k in range(12)), "cable0_mm"
    ]  # fmt: skip
    # 101.325 kPa reads 4.08 V, up to a zero of 2.5 %.
    np.testing.assert_allclose(values[:, :6].mean(axis=0), 5 * (0.009 * 101.325 - 0.095), atol=0.2)
    assert np.abs(values[:, 18].mean()) < 0.05 and 0.02 < values[:, 18].std() < 0.1


def test_as_fast_as_read_the_whole_programme_comes_and_repeats(
    code_of: Callable[..., int], tmp_path: Path
) -> None:
    link, truth = tmp_path / "pad", tmp_path / "truth.csv"
    listener = Listener(link)
    arguments = ["--link", link, "--rate", "max", "--for", "6", "--truth", truth, "--seed", "3"]
    assert code_of("virtual-device", CONFIGS / "pad.toml", *arguments) == 0
    values = listener.values()
    assert listener.decoder.counts.line.bytes_discarded == 0
    sequence = np.array([number for _, number, *_ in listener.samples])
    assert (np.diff(sequence) == 1).all()
    with truth.open() as stream:
        rows = list(csv.DictReader(stream))
    force = np.array([float(row["true_force_N"]) for row in rows])[sequence[-len(values) :]]
    most = force.max()
    assert len(values) > 7000 and 0.35 * 25 < most < 0.75 * 25
    # 10 mm³/N at up to 1.5 F in 2.5 s squeezed, and in 3 s let go, reads 12 mV for each newton a second.
    assert values[:, 0].max() == pytest.approx(0.5 + 0.012 * 1.5 * most / 2.5, abs=0.02)
    assert values[:, 0].min() == pytest.approx(0.5 - 0.012 * 1.5 * most / 3.0, abs=0.02)
    assert np.corrcoef(force > 0, values[:, 4:12].max(axis=1))[0, 1] > 0.5


def test_faults_are_told_at_the_end(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "pad"
    listener = Listener(link)
    faults = ("lose-samples=0.2", "drop-bytes=1e-3", "flip-bits=1e-4", "silent=row2@0.3", "unplug=0.3/1")
    options = [text for fault in faults for text in ("--fault", fault)]
    assert code_of("virtual-device", CONFIGS / "pad.toml", "--link", link, "--for", "1.2", *options) == 0
    out = capsys.readouterr().out
    for what in ("samples lost", "bytes dropped", "bits flipped", "1 times away"):
        assert what in out
    values = listener.values()
    assert np.isnan(values[-1, 6]) and np.isfinite(np.delete(values[-1], 6)).all()
    assert listener.decoder.counts.line.crc_failures + listener.decoder.counts.line.cobs_failures > 0


def test_a_termination_ends_it_as_an_interrupt_does(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link, truth = tmp_path / "pad", tmp_path / "truth.csv"
    listener = Listener(link)

    def terminate() -> None:
        while len(listener.samples) < 20:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=terminate, daemon=True).start()
    assert code_of("virtual-device", CONFIGS / "pad.toml", "--link", link, "--truth", truth) == 130
    assert not link.is_symlink()
    assert "packets heard" in capsys.readouterr().out
    with truth.open() as stream:
        assert len(list(csv.DictReader(stream))) >= 20


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--rate", "fast"], "--rate fast"),
        (["--rate", "0.1"], "1 to 100000 Hz"),
        (["--for", "-1"], "--for -1"),
        (["--tcp", "70000"], "70000"),
        (["--fault", "rain=1"], "no such fault"),
        (["--fault", "drop-bytes"], "no such fault"),
        (["--fault", "drop-bytes=many"], '"many" is not a number'),
        (["--fault", "drop-bytes=0.9"], "between 0 and 0.5"),
        (["--fault", "unplug=2"], "such as 2/30"),
        (["--fault", "unplug=3/2"], "away for 3 s"),
        (["--fault", "unplug=1/2", "--fault", "power-cut=1/2"], "twice"),
        (["--fault", "clock-drift=1e9"], "ppm"),
        (["--fault", "silent=row9@3"], '"row9"'),
        (["--fault", "stuck=row1"], "row3@20"),
    ],
)
def test_mistakes_are_a_line_and_two(
    code_of: Callable[..., int], options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("virtual-device", CONFIGS / "pad.toml", *options) == 2
    out, err = capsys.readouterr()
    assert out == "" and said in err and err.count("\n") == 1


def test_two_boards_of_sensors_that_all_see_no_contact_are_refused(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (CONFIGS / "pad.toml").read_text(encoding="utf-8")
    path = tmp_path / "other.toml"
    cut = text.index("[[sensor]]                                      # single-ended")
    path.write_text(text[:cut], encoding="utf-8")
    assert code_of("virtual-device", path, "--for", "1", "--boards", "2") == 2
    assert "for two boards" in capsys.readouterr().err


def test_a_robot_without_sensors_has_nothing_to_send(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (CONFIGS / "pad.toml").read_text(encoding="utf-8")
    path = tmp_path / "other.toml"
    path.write_text(text[: text.index("[[sensor]]")], encoding="utf-8")
    assert code_of("virtual-device", path, "--for", "1") == 2
    assert "sensor: missing" in capsys.readouterr().err


def test_files_of_others_are_left_alone(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine"
    mine.write_text("precious")
    for option in ("--truth", "--link"):
        assert code_of("virtual-device", CONFIGS / "pad.toml", option, mine, "--for", "1") == 2
        assert str(mine) in capsys.readouterr().err
    assert mine.read_text() == "precious"
