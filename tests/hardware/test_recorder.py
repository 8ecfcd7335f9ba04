"""The recorder never blocks, and says what is in no file."""

import json
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import RecordingError
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.record.entries import FrameEntry, SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.stream import Chunk, HostClock, Notice

INFO = SessionInfo(device="d", channels=("a",), sources=(SourceInfo("loop://", "softfuse"),))


def test_everything_is_in_the_file_in_order(tmp_path: Path) -> None:
    told: list[Notice] = []
    recorder = Recorder(tmp_path / "s.mcap", INFO, HostClock(), told.append)
    for k in range(500):
        recorder.put(Chunk(0, 1e9 + k, bytes([k % 256])))
        recorder.put(FrameEntry(k, 1e9 + k, np.array([float(k)])))
    recorder.put(Notice(1e9, None, "info", "done"))
    recorder.close()
    session = RecordedSession(tmp_path / "s.mcap")
    assert session.complete and told == [] and recorder.lost == 0
    assert [c.data[0] for c in session.chunks()] == [k % 256 for k in range(500)]
    assert [f.values[0] for f in session.frames()] == list(range(500))
    assert [n.text for n in session.notices()] == ["done"]


def test_it_is_on_the_disk_before_it_is_closed(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "s.mcap", INFO, HostClock(), lambda notice: None)
    recorder.put(FrameEntry(0, 1e9, np.array([7.0])))
    deadline = time.monotonic() + 20.0
    while not [*RecordedSession(tmp_path / "s.mcap").frames()] and time.monotonic() < deadline:
        time.sleep(0.05)
    assert [f.values[0] for f in RecordedSession(tmp_path / "s.mcap").frames()] == [7.0]
    recorder.close()


def test_a_file_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="exists"):
        Recorder(path, INFO, HostClock(), lambda notice: None)
    assert path.read_bytes() == b"precious"


FULL = """
    import json, resource, signal, sys, time
    from pathlib import Path
    import numpy as np
    from softfuse.hardware.live.recorder import Recorder
    from softfuse.hardware.record.entries import FrameEntry, SessionInfo
    from softfuse.hardware.stream import HostClock

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    # Files of this process cannot become longer: for each of them the disk is full.
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
    told = []
    names = tuple(f"c{k}" for k in range(20))
    recorder = Recorder(
        Path(sys.argv[1]), SessionInfo(channels=names), HostClock(), told.append, retry_s=0.5
    )
    rng, longest, sent = np.random.default_rng(0), 0.0, 0
    end = time.monotonic() + 4.0
    while time.monotonic() < end:
        began = time.monotonic()
        recorder.put(FrameEntry(sent, 1e9 + sent, rng.normal(size=20)))
        longest, sent = max(longest, time.monotonic() - began), sent + 1
        time.sleep(0.001)
    recorder.close()
    print(json.dumps({"sent": sent, "lost": recorder.lost, "longest": longest,
                      "told": [(n.level, n.text) for n in told]}))
"""


def test_a_full_disk_stalls_nothing_is_told_and_another_file_goes_on(tmp_path: Path) -> None:
    command = [sys.executable, "-c", textwrap.dedent(FULL), str(tmp_path / "s.mcap")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["told"][0][0] == "error" and "recording stopped, estimation goes on" in found["told"][0][1]
    assert found["told"][1][0] == "warning" and "s-2.mcap" in found["told"][1][1]
    assert found["longest"] < 1.0
    sessions = [
        RecordedSession(path) for path in sorted(tmp_path.glob("*.mcap"), key=lambda p: p.stat().st_mtime)
    ]
    assert len(sessions) >= 2
    indices = [frame.index for session in sessions for frame in session.frames()]
    assert indices == sorted(set(indices))
    assert 0 < found["lost"] == found["sent"] - len(indices)
