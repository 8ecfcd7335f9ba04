"""softfuse run on two virtual boards whose ports go away and come back: what is lost is told."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from served import Served

from softfuse.experiment.performance import Programme
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.virtual.board import BoardClock, VirtualBoard
from softfuse.hardware.virtual.faults import FaultyLine, LineFaults, Outages
from softfuse.hardware.virtual.ports import PseudoTerminal
from softfuse.hardware.virtual.serving import VirtualPort
from softfuse.hardware.wire.description import Channel, Description, RawType
from softfuse.report.live import LiveEstimates
from softfuse.robot.file import load
from softfuse.robot.settings import RobotSettings

RATE_HZ, DRIFT_PPM = 100.0, 200.0
AWAY_S, EVERY_S, LENGTH_S = 0.7, 2.5, 8.0
BACK_S = 1.0
"""So long after the port's return frames come again at the latest."""


def port_of(number: int, programme: Programme, rate_Hz: float, drift_ppm: float) -> VirtualPort:
    channels = tuple(Channel(name, RawType.F64, 1.0, 0.0) for name in programme.channels)
    description = Description(f"board {number}", channels)
    clock = BoardClock(rate_Hz, 1_000_000 * number, drift_ppm)
    board = VirtualBoard(number, description, programme.at, clock)
    return VirtualPort(board, FaultyLine(LineFaults(), (number,)), [PseudoTerminal(Path(f"{number}"))])


@pytest.fixture(scope="module", params=[False, True], ids=["unplugged", "without power"])
def powered(request: pytest.FixtureRequest) -> bool:
    """Whether boards lose their power with their ports."""
    return request.param


@pytest.fixture(scope="module")
def recorded(
    powered: bool, code_of: Callable[..., int], tmp_path_factory: pytest.TempPathFactory, coarse: Path
) -> RecordedSession:
    """Two boards with clocks of their own; every channel says the true time [s] since they began."""
    settings = load(coarse)
    folder = tmp_path_factory.mktemp("session")
    lines, flows = (
        tuple(name for name in settings.channels if name.startswith("flow") == flow) for flow in (False, True)
    )
    ports = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for number, names, rate_Hz, drift in (
            (1, lines, RATE_HZ, DRIFT_PPM),
            (2, flows, 2 * RATE_HZ, -DRIFT_PPM),
        ):
            readings = np.tile(np.linspace(0.0, 600.0, 601)[:, None], len(names))
            ports.append(port_of(number, Programme(1.0, names, readings, {}), rate_Hz, drift))
        device = Served(ports, outages=Outages(AWAY_S, EVERY_S, powered))

        built = LiveEstimates.built

        def built_then_plugged(settings: RobotSettings, charts: Path | None = None) -> LiveEstimates:
            live = built(settings, charts)
            device.start()  # compiling would take until after the first outage
            return live

        patch.setattr(LiveEstimates, "built", built_then_plugged)
        urls = [argument for port in ports for argument in ("--port", port.urls[0])]
        assert code_of("run", coarse, *urls, "--record", "s.mcap", "--for", LENGTH_S) == 0
        device.stop()
    return RecordedSession(folder / "s.mcap")


@pytest.fixture(scope="module")
def frames(recorded: RecordedSession) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s] of each frame, and what an electrode and a flow of it say [s], NaN where nothing."""
    found = [*recorded.frames()]
    columns = [recorded.info.channels.index(name) for name in ("row0", "flow0_V")]
    electrode, flow = np.array([frame.values[columns] for frame in found]).T
    # Until the board of the electrodes has been heard of, the other sets the pace.
    begun = int(np.argmax(np.isfinite(electrode)))
    assert begun < 10
    return np.array([frame.time_s for frame in found])[begun:], electrode[begun:], flow[begun:]


def test_frames_come_again_soon_and_none_are_made_up(frames: tuple[np.ndarray, ...]) -> None:
    time_s, electrode, _ = frames
    gaps = np.diff(time_s)
    outages = gaps[gaps > 0.5 * AWAY_S]
    assert len(outages) == 3 and outages.min() > AWAY_S - 0.1 and outages.max() < AWAY_S + BACK_S
    # Each frame is a sample of its own. Their times are true but for where they began, and for a few, until
    # the least delay of a line on a busy computer has shown itself.
    assert np.all(np.diff(electrode) > 0.5 / RATE_HZ)
    early, late = np.quantile(time_s - electrode, [0.05, 0.95])
    assert late - early < 0.02


def test_both_boards_are_on_one_clock(frames: tuple[np.ndarray, ...]) -> None:
    _, electrode, flow = frames
    both = np.isfinite(flow)
    assert both.mean() > 0.95
    assert np.quantile(np.abs(flow - electrode)[both], 0.95) < 0.02


def test_every_outage_and_every_lost_sample_is_recorded(
    recorded: RecordedSession, powered: bool, frames: tuple[np.ndarray, ...]
) -> None:
    told = [notice for notice in recorded.notices()]
    for source in (0, 1):
        own = [notice.text for notice in told if notice.source == source]
        assert sum("waiting for it to come back" in text for text in own) == 3
        assert sum("in which nothing was read" in text for text in own) == 3
        assert sum("has restarted" in text for text in own) == (3 if powered else 0)
    lost = [
        int(found[1])
        for notice in told
        if (found := re.search(r"device 1: (\d+) samples lost", notice.text)) is not None
    ]
    _, electrode, _ = frames
    steps = np.rint(np.diff(electrode) * RATE_HZ).astype(int)
    # Who has restarted cannot tell what it missed.
    assert lost == ([] if powered else (steps[steps > 1] - 1).tolist())
