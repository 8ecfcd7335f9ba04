"""softfuse virtual-device: from a configuration to frames on a port, with a body that is made up here."""

import csv
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import serial

from softfuse.experiment import kept_poses
from softfuse.experiment.finger_pushes import CONTACTS, Pose, Push, Steps, cable_levels, depth_levels
from softfuse.experiment.pad_electrodes import AbstractPadElectrodes, GridElectrodes, LineElectrodes
from softfuse.experiment.pad_touches import PadTouches
from softfuse.experiment.virtual_finger import FingerSettings
from softfuse.experiment.virtual_pad import PadPose, PadSettings, Touch
from softfuse.hardware.wire.decoder import Decoder
from softfuse.hardware.wire.message import EVERY_DEVICE, AskMessage, Header, SampleMessage, encode
from softfuse.hardware.wire.packet import pack
from softfuse.sensors.crossed.field import CrossedLines

CONFIGS = Path(__file__).parents[2] / "configs"
ASK = pack(encode(AskMessage(Header(EVERY_DEVICE, 0, 0))))
FLOWS = [f"flow{k}_V" for k in range(4)]
LINES = [f"{side}{k}" for side in ("row", "col") for k in range(8)]
CELLS = [f"cell{row}{column}" for row in range(4) for column in range(4)]


class MadeUpBed:
    """Volumes in proportion to force, and electrodes that need no equilibrium."""

    def __init__(self, settings: PadSettings, electrodes: AbstractPadElectrodes, gaps) -> None:
        del settings
        self._electrodes, self._gaps = electrodes, gaps

    def touched(self, touch: Touch, *, solved=None) -> PadTouches:
        del solved
        electrodes, gaps = self._electrodes, np.array(self._gaps)
        at, force = np.array([touch.at]), np.array([(0.0, *touch.forces)])
        match electrodes:
            case LineElectrodes():
                near, pressed = made_up_lines(electrodes.lines, at, gaps, force.shape[1])
            case GridElectrodes():
                near, pressed = of_a_grid(electrodes, at, self._gaps, force)
            case _:
                raise TypeError(f"{electrodes} are not made up here")
        return PadTouches(
            at=at,
            gap=gaps,
            near=near,
            force=force,
            depth=1e-4 * force,
            volume=-1e-8 * force[:, :, None] * np.ones(4),
            pressed=pressed,
        )


def made_up_lines(
    lines: CrossedLines, at: np.ndarray, gaps: np.ndarray, forces: int
) -> tuple[np.ndarray, np.ndarray]:
    """A peak at the place on every line, near and pressed."""
    middles = np.concatenate([np.array(lines.row_y), np.array(lines.column_x)])
    apart = middles - np.concatenate(
        [np.repeat(at[:, 1:], 8, axis=1), np.repeat(at[:, :1], 8, axis=1)], axis=1
    )
    peak = 2e-12 * np.exp(-((apart / 10e-3) ** 2))
    return peak[:, None] * np.exp(-gaps / 2e-3)[:, None], peak[:, None] * np.ones((forces, 1))


def of_a_grid(
    electrodes: GridElectrodes, at: np.ndarray, gaps, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What the grid really says, near and pressed: it takes no more than the force from an equilibrium."""
    places = [(float(x), float(y)) for x, y in at]
    near = np.array([[electrodes.near(place, gap) for gap in gaps] for place in places])
    poses = [[PadPose(float(f), 0.0, np.zeros(4), np.zeros((0, 3))) for f in forces] for forces in force]
    pressed = [
        [electrodes.pressed(place, pose, electrodes.points) for pose in each]
        for place, each in zip(places, poses, strict=True)
    ]
    return near, np.array(pressed)


class MadeUpFinger:
    """Bends and presses back in proportion."""

    def __init__(self, settings: FingerSettings, steps: Steps) -> None:
        self._settings, self._steps = settings, steps

    def poses(self, push: Push, *, solved=None) -> list[Pose]:
        del solved
        depths = depth_levels(push, self._steps).tolist() if push.contacts else []
        walk = [(cable, -0.03) for cable in cable_levels(push, self._steps).tolist()]
        walk += [(push.cable, depth) for depth in depths]
        return [self._pose(push, *each) for each in walk]

    def _pose(self, push: Push, cable: float, depth: float) -> Pose:
        segments = len(self._settings.segment_x)
        places = np.zeros((3 * segments, 9, 3))
        places[:, :, 0] = np.repeat(self._settings.segment_x, 3)[:, None]
        places[:, :, 1] = np.tile([0.0, 0.01, -0.01], segments)[:, None]
        tips = np.zeros((CONTACTS, 3))
        axis = np.zeros((CONTACTS, 3))
        for k, (segment, _) in enumerate(push.contacts):
            tips[k] = self._settings.segment_x[segment], 0.015 - depth, 0.0
            axis[k] = 0.0, 0.0, 1.0
        return Pose(
            cable=np.array(cable), depth=np.array(depth), points=np.zeros((len(self._settings.points), 3)),
            electrodes=places, gauge=1e5 * max(depth, 0.0) * np.ones(6), tension=np.array(100 * cable),
            force=np.array([50.0 * max(depth, 0.0), 0.0]), contact=tips, tip=tips, axis=axis,
        )  # fmt: skip


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is solved."""
    monkeypatch.setattr(kept_poses, "PadBed", MadeUpBed)
    monkeypatch.setattr(kept_poses, "virtual_finger", lambda settings: settings)
    monkeypatch.setattr(kept_poses, "FingerSolver", lambda settings, steps: MadeUpFinger(settings, steps))


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
    assert list(rows[0])[:6] == ["time_s", "press", "sample", "true_x_mm", "true_y_mm", "true_force_N"]
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

    force, depth, press = (true(name) for name in ("true_force_N", "true_depth_mm", "press"))
    lines_mm = np.array([-24.0, -8.0, 8.0, 24.0])
    for number in range(2):
        here = press == number
        far, low = here & (depth < -59.0), here & (depth > -0.3) & (depth <= 0.0) & (force < 0.05)
        firm = here & (force > 0.99 * force.max())
        assert min(far.sum(), low.sum(), firm.sum()) > 5
        row = np.argmin(np.abs(lines_mm - np.median(true("true_y_mm")[firm])))
        column = np.argmin(np.abs(lines_mm - np.median(true("true_x_mm")[firm])))
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
    assert len(values) > 4000 and force.max() == pytest.approx(15.0)
    # 10 mm³/N at up to 9 N/s squeezed, and up to 15 N/s let go.
    assert 0.58 < values[:, 0].max() < 0.65 and 0.30 < values[:, 0].min() < 0.42
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


@pytest.mark.parametrize(
    ("config", "change", "said"),
    [
        ("pad", ("direction = [0, 0, -1]", "direction = [0, 1, -1]"), "contact: a virtual pad"),
        ("finger", ("direction = [0, 0, 1]", "direction = [1, 0, 1]"), "electrode[0].direction"),
        ("finger", ('"MPX5100A"', '"MPX5100G"'), "MPX5100A"),
        (
            "finger",
            ('"100 mm^3"', '["1 mm^3", "1 mm^3", "1 mm^3", "1 mm^3", "1 mm^3", "2 mm^3"]'),
            "dead_volume",
        ),
    ],
)
def test_devices_that_have_no_virtual_body_are_told(
    code_of: Callable[..., int],
    config: str,
    change: tuple[str, str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = (CONFIGS / f"{config}.toml").read_text(encoding="utf-8")
    assert change[0] in text
    path = tmp_path / "other.toml"
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    assert code_of("virtual-device", path, "--for", "1") == 2
    assert said in capsys.readouterr().err


def test_files_of_others_are_left_alone(
    code_of: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine"
    mine.write_text("precious")
    for option in ("--truth", "--link"):
        assert code_of("virtual-device", CONFIGS / "pad.toml", option, mine, "--for", "1") == 2
        assert str(mine) in capsys.readouterr().err
    assert mine.read_text() == "precious"
