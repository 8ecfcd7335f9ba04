"""Sessions whose process was killed or whose disk was full: what was written before can be read."""

import errno
import json
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from softfuse.hardware.record.session_reader import RecordedSession

PACKAGE = Path(__file__).parents[2]
HEAD = """
import json, math, resource, sys, time
import numpy as np
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, SessionInfo, SourceInfo
from softfuse.hardware.record.session_writer import SessionWriter
from softfuse.hardware.stream import Chunk, HostClock

names = tuple(f"c{k}_V" for k in range(20))
info = SessionInfo(device="pad", channels=names, estimates={"force_N": "number"},
                   sources=(SourceInfo("loop://", "wire"),))
noise = np.random.default_rng(0)

def write(writer, i, at):
    writer.add(Chunk(0, at, noise.bytes(80)))
    writer.add(FrameEntry(i, at, noise.normal(size=20)))
    writer.add(EstimateEntry(i, at, at, {"force_N": 1.0 * i}, ("ok",), 1.0, 2.0))
"""
LIVE = """
clock = HostClock()
writer = SessionWriter(sys.argv[1], info)
begin = time.monotonic()
for i in range(100000):
    at = clock.now_s()
    write(writer, i, at)
    print(i, repr(at), flush=True)
    time.sleep(max(0.0, begin + 0.01 * (i + 1) - time.monotonic()))
"""
FULL = """
limit = 400_000
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
writer = SessionWriter(sys.argv[1], info)
flushed, errors = 0, []
for i in range(100000):
    try:
        write(writer, i, 1.8e9 + 0.01 * i)
        if i % 50 == 49:
            writer.flush()
            flushed = i + 1
    except OSError as error:
        errors.append(error.errno)
        if len(errors) == 3:
            break
writer.close()
print(json.dumps({"flushed": flushed, "errors": errors}))
"""


def started(code, path):
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(HEAD) + code, str(path)],
        cwd=PACKAGE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_after_kill_9_all_but_the_last_second_is_there(tmp_path):
    paths = [tmp_path / f"{k}.mcap" for k in range(3)]
    running = [started(LIVE, path) for path in paths]
    for process in running:
        assert process.stdout.readline()
    # Moments spread over the half second between two hand-overs.
    for process, wait in zip(running, (1.6, 0.17, 0.18), strict=True):
        time.sleep(wait)
        process.send_signal(signal.SIGKILL)
    for path, process in zip(paths, running, strict=True):
        out, err = process.communicate(timeout=10)
        assert process.returncode == -signal.SIGKILL and err == ""
        written = [(int(i), float(at)) for i, at in (line.split() for line in out.splitlines()[:-1])]
        last = written[-1][1]
        due = [i for i, at in written if at < last - 1.0]
        session = RecordedSession(path)
        frames = list(session.frames())
        assert not session.complete and session.unreadable == 0 and len(due) > 20
        assert [frame.index for frame in frames] == list(range(len(frames)))
        assert len(frames) > due[-1]
        times = dict(written)
        assert all(frame.time_s == times.get(frame.index, frame.time_s) for frame in frames)
        assert len(list(session.estimates())) > due[-1] and len(list(session.chunks())) > due[-1]


def test_a_full_disk_is_told_and_what_was_written_before_stays(tmp_path):
    path = tmp_path / "a.mcap"
    process = started(FULL, path)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (0, "")
    told = json.loads(out)
    assert told["errors"] == [errno.EFBIG] * 3 and told["flushed"] >= 100
    session = RecordedSession(path)
    found = list(session.frames())
    assert path.stat().st_size <= 400_000
    assert not session.complete and session.cut_bytes == 0 and session.unreadable == 0
    assert [frame.index for frame in found] == list(range(len(found))) and len(found) >= told["flushed"]


@pytest.mark.parametrize("limit", [0, 5, 300])
def test_a_disk_that_is_full_from_the_start_leaves_no_file(tmp_path, limit):
    path = tmp_path / "a.mcap"
    code = f"""
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
SessionWriter(sys.argv[1], info)
"""
    process = started(code, path)
    _, err = process.communicate(timeout=30)
    assert "RecordingError: cannot write" in err.splitlines()[-1] and "File too large" in err
    assert not path.exists()
