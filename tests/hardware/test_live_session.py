"""The live loop's threads: nothing waits for a slow estimator, and what it never saw is counted.

What is estimated is tested with real bodies elsewhere; here an estimator takes as long as it is told.
"""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.estimation.stream import Estimate
from softfuse.estimation.tracked import Frame, Tracked
from softfuse.hardware.live.pipeline import Pipeline
from softfuse.hardware.live.recorder import Recorder
from softfuse.hardware.live.replay import Comparison, Replay
from softfuse.hardware.live.session import Published, Session, besides_samples
from softfuse.hardware.record.entries import SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.source.softfuse_frames import SoftfuseFrames
from softfuse.hardware.stream import Chunk, HostClock
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import DescriptionMessage, Header, SampleMessage, encode, pack
from softfuse.mechanics.solution import State
from softfuse.sensors.status import Status

DESCRIPTION = Description("board", (Channel("a", RawType.F64, 1.0, 0.0),))
LAYOUT = Layout(DESCRIPTION)


class Follower:
    """Takes `seconds` for an estimate and keeps what it saw; fails at the frame `fails_at`."""

    def __init__(self, seconds: float, fails_at: float = np.inf):
        self.seconds, self.fails_at = seconds, fails_at
        self.sensed: list[float] = []
        self.estimated: list[float] = []

    def follow(self, frames: Iterable[tuple[Frame, bool]]) -> Iterator[Estimate]:
        nothing = np.zeros(0)
        place, sure, covariance = (np.zeros((0, n)) for n in (3, 2, 0))
        tracked = Tracked(
            0.0,
            *(nothing > 0, place, sure, nothing, covariance, place, covariance, *[nothing] * 5),
            *(None, None, (Status.ok,), self.seconds),
        )
        for frame, wanted in frames:
            if frame.raw[0] >= self.fails_at:
                raise ZeroDivisionError("a fault of ours")
            self.sensed.append(float(frame.raw[0]))
            if wanted:
                time.sleep(self.seconds)
                self.estimated.append(self.sensed[-1])
                yield Estimate(tracked, None, State(*[jnp.zeros(0)] * 4))

    def fields(self, now: Estimate) -> dict[str, float]:
        return {"seen": self.estimated[-1]}


def chunks(count: int) -> list[Chunk]:
    now = HostClock().now_s()
    data = [pack(encode(DescriptionMessage(Header(0, 0, 0), DESCRIPTION)))]
    for k in range(count):
        content = LAYOUT.content(np.array([float(k)]))
        data.append(pack(encode(SampleMessage(Header(0, k, 1000 * k), LAYOUT.number, content))))
    return [Chunk(0, now + 1e-6 * k, each) for k, each in enumerate(data)]


def session_of(follower: Follower, published: list[Published], length: int = 100) -> Session:
    pipeline = Pipeline(("a",), [SoftfuseFrames()])
    return Session(pipeline, follower, HostClock(), queue_length=length, publish=[published.append])


def test_every_frame_is_sensed_and_the_newest_estimated() -> None:
    follower, published = Follower(0.01), list[Published]()
    session = session_of(follower, published, length=10_000)
    session.start()
    for chunk in chunks(500):
        session.receive(chunk)
    session.stop()
    report = session.report
    assert follower.sensed == list(range(500)) and follower.estimated[-1] == 499
    assert report.frames == report.sensed == 500 and report.overruns == 0
    assert report.estimated == len(published) == len(follower.estimated) < 500
    assert [p.fields["seen"] for p in published] == follower.estimated
    assert [p.number for p in published] == follower.estimated


def test_what_a_slow_estimator_never_saw_is_counted_and_recorded(tmp_path: Path) -> None:
    follower, published = Follower(0.2), list[Published]()
    session = session_of(follower, published, length=20)
    info = SessionInfo(channels=("a",), estimates={"seen": "number"}, sources=(SourceInfo("x", "softfuse"),))
    session.start(Recorder(tmp_path / "s.mcap", info, HostClock(), session.show))
    began = time.monotonic()
    for chunk in chunks(2000):
        session.receive(chunk)
    assert time.monotonic() - began < 5.0, "who reads the port waited for the estimator"
    session.stop()
    report = session.report
    assert report.frames == 2000 and report.overruns > 1000
    assert report.sensed + report.overruns == 2000 and follower.sensed[-1] == 1999
    assert follower.sensed == sorted(set(follower.sensed))
    recorded = RecordedSession(tmp_path / "s.mcap")
    assert [f.values[0] for f in recorded.frames()] == list(range(2000)), "the recorder gets all"
    assert [e.frame for e in recorded.estimates()] == follower.estimated
    assert sum(e.sensed or 0 for e in recorded.estimates()) == report.sensed
    again = Follower(0.0)
    replay = Replay(recorded, Pipeline(("a",), [SoftfuseFrames()]), again)
    assert len([*replay.run()]) == report.estimated
    assert again.sensed == follower.sensed and again.estimated == follower.estimated
    assert replay.comparison == Comparison(report.estimated, report.estimated, None)
    assert report.latency_p50_s >= 0.2


def test_what_was_wrong_with_the_bytes_is_counted_and_told() -> None:
    session = session_of(Follower(0.0), [])
    session.start()
    for k, chunk in enumerate(chunks(50)):
        data = bytearray(chunk.data)
        if k in (10, 20):
            data[-4] ^= 0x10
        session.receive(Chunk(0, chunk.host_s, bytes(data)))
    session.stop()
    report = session.report
    assert report.frames == 48 and report.devices[0].samples.lost == 2
    failures = report.line_counts[0]["CRC failures"] + report.line_counts[0]["COBS failures"]
    assert failures == 2
    (told,) = besides_samples(report)
    assert "failures" in told and "samples" not in told


def test_a_fault_ends_the_session_and_is_raised() -> None:
    session = session_of(Follower(0.0, fails_at=50), [])
    session.start()
    for chunk in chunks(100):
        session.receive(chunk)
    deadline = time.monotonic() + 20.0
    while not session.failed and time.monotonic() < deadline:
        time.sleep(0.01)
    assert session.failed
    with pytest.raises(ZeroDivisionError, match="a fault of ours"):
        session.stop()


def test_stopping_what_never_started_is_nothing() -> None:
    session_of(Follower(0.0), []).stop()
