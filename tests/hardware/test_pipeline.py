"""From chunks to frames: devices, gaps, restarts, interruptions; the same chunks give the same frames."""

import numpy as np
import pytest

from softfuse.hardware.live.pipeline import Assembled, Pipeline
from softfuse.hardware.source.softfuse_frames import SoftfuseFrames
from softfuse.hardware.stream import Chunk
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import DescriptionMessage, Header, SampleMessage, encode, pack

START_S = 1.7e9


class Board:
    """A device that samples every 10 ms and starts with its description."""

    def __init__(self, number: int, *names: str, began_us: int = 0):
        self.number, self.began_us = number, began_us
        self.description = Description(
            f"board {number}", tuple(Channel(n, RawType.F64, 1.0, 0.0) for n in names)
        )
        self.layout = Layout(self.description)

    def hello(self) -> bytes:
        return pack(encode(DescriptionMessage(Header(self.number, 0, 0), self.description)))

    def sample(self, k: int, *values: float) -> bytes:
        header = Header(self.number, k, self.began_us + 10_000 * k)
        content = self.layout.content(np.array(values))
        return pack(encode(SampleMessage(header, self.layout.number, content)))


def chunk(source: int, k: int, data: bytes) -> Chunk:
    return Chunk(source, START_S + 0.01 * k + 0.001, data)


def fed(pipeline: Pipeline, chunks: list[Chunk]) -> tuple[list[Assembled], list[str]]:
    """The frames, and what was warned of."""
    frames, told = [], []
    for each in chunks:
        made, notices = pipeline.feed(each)
        frames += made
        told += [notice.text for notice in notices if notice.level != "info"]
    return frames, told


def test_a_frame_for_each_sample_at_the_devices_own_spacing() -> None:
    board = Board(3, "b", "a")
    pipeline = Pipeline(("a", "b"), [SoftfuseFrames()])
    data = [board.hello()] + [board.sample(k, 1.0 * k, 2.0 * k) for k in range(50)]
    # Two packets come at once, late by 10 ms every other time.
    chunks = [chunk(0, 2 * k + 1, b"".join(data[2 * k : 2 * k + 2])) for k in range(26)]
    frames, told = fed(pipeline, chunks)
    assert len(frames) == 50 and told == [] and pipeline.missing == []
    np.testing.assert_array_equal([frame.values for frame in frames], [[2.0 * k, 1.0 * k] for k in range(50)])
    spacing = np.diff([frame.time_s for frame in frames])
    assert np.all(spacing > 0.004) and np.all(spacing < 0.016)
    assert [report.samples.fresh for report in pipeline.devices] == [50]


def test_gaps_and_restarts_are_told_and_doubled_samples_are_left_out() -> None:
    board = Board(0, "a")
    pipeline = Pipeline(("a",), [SoftfuseFrames()])
    sent = [board.hello()] + [board.sample(k, float(k)) for k in (0, 1, 2, 2, 6, 7, 5)]
    frames, told = fed(pipeline, [chunk(0, k, data) for k, data in enumerate(sent)])
    assert [frame.values[0] for frame in frames] == [0.0, 1.0, 2.0, 6.0, 7.0]
    assert told == ["device 0: 3 samples lost before sample 6"]
    (report,) = pipeline.devices
    assert (report.samples.lost, report.samples.duplicated, report.samples.late) == (2, 1, 1)
    anew = Board(0, "a", began_us=3_000)
    frames, told = fed(pipeline, [chunk(0, 900, anew.hello() + anew.sample(0, 9.0))])
    assert [frame.values[0] for frame in frames] == [9.0] and told == ["device 0: has restarted"]
    assert frames[0].time_s == pytest.approx(START_S + 9.001)


def test_two_sources_make_one_frame() -> None:
    electrodes, flows = Board(1, "row0", "row1"), Board(1, "flow0_V")
    pipeline = Pipeline(("flow0_V", "row0", "row1"), [SoftfuseFrames(), SoftfuseFrames()])
    chunks = [chunk(0, 0, electrodes.hello()), chunk(1, 0, flows.hello())]
    for k in range(100):
        chunks.append(chunk(0, k, electrodes.sample(k, 10.0 + k, 20.0 + k)))
        chunks.append(chunk(1, k, flows.sample(k, 100.0 + k)))
    frames, told = fed(pipeline, chunks)
    assert told == [] and len(frames) >= 98
    for frame in frames[1:]:
        flow, row0, row1 = frame.values
        assert row1 == row0 + 10.0
        # The devices' clocks are told apart to a fraction of a sample.
        assert flow == pytest.approx(row0 + 90.0, abs=0.2)
    sources = {report.source: report.samples.fresh for report in pipeline.devices}
    assert sources == {0: 100, 1: 100}


def test_an_interruption_forgets_half_a_packet() -> None:
    board = Board(0, "a")
    pipeline = Pipeline(("a",), [SoftfuseFrames()])
    half = board.sample(1, 1.0)
    chunks = [chunk(0, 0, board.hello() + board.sample(0, 0.0) + half[:9]), chunk(0, 1, b"")]
    chunks.append(chunk(0, 2, board.sample(2, 2.0)))
    frames, _ = fed(pipeline, chunks)
    assert [frame.values[0] for frame in frames] == [0.0, 2.0]
    assert pipeline.devices[0].samples.lost == 1


def test_a_sample_before_its_description_makes_the_host_ask() -> None:
    board = Board(0, "a")
    pipeline = Pipeline(("a",), [SoftfuseFrames()])
    frames, _ = fed(pipeline, [chunk(0, 0, board.sample(0, 0.0))])
    assert frames == [] and pipeline.take_requests(0) != b"" and pipeline.take_requests(0) == b""


def test_the_same_chunks_give_the_same_frames_however_they_are_cut() -> None:
    boards = Board(0, "a"), Board(1, "b", "c")
    rng = np.random.default_rng(1)
    chunks = [chunk(0, 0, boards[0].hello() + boards[1].hello())]
    for k in range(200):
        late = 0.005 * rng.random()
        for board, values in zip(boards, ((1.0 * k,), (2.0 * k, 3.0 * k)), strict=True):
            if rng.random() < 0.95:
                chunks.append(Chunk(0, START_S + 0.01 * k + late, board.sample(k, *values)))
    once, told = fed(Pipeline(("a", "b", "c"), [SoftfuseFrames()]), chunks)
    again, told_again = fed(Pipeline(("a", "b", "c"), [SoftfuseFrames()]), chunks)
    assert told == told_again and len(told) > 5
    assert [f.time_s for f in once] == [f.time_s for f in again]
    np.testing.assert_array_equal([f.values for f in once], [f.values for f in again])
    bytewise = [Chunk(0, c.host_s, bytes([byte])) for c in chunks for byte in c.data]
    cut, _ = fed(Pipeline(("a", "b", "c"), [SoftfuseFrames()]), bytewise)
    assert [f.time_s for f in cut] == [f.time_s for f in once]
