"""Listening to a source: rates, losses, drift and jitter against samples of known ones."""

import math

import numpy as np
import pytest

from softfuse.hardware.source.listening import Listener
from softfuse.hardware.source.softfuse_frames import SoftfuseFrames
from softfuse.hardware.source.text_lines import TextFormat, TextLines
from softfuse.hardware.stream import Chunk
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import DescriptionMessage, Header, SampleMessage, encode, pack

BOARD = Description("b", tuple(Channel(name, RawType.F32, 1.0, 0.0) for name in ("a_V", "b_V")))
LAYOUT = Layout(BOARD)
START = 1_800_000_000.0


def described(k: int = 0) -> bytes:
    return pack(encode(DescriptionMessage(Header(3, k, 0), BOARD)))


def sample(k: int, at_us: int, values=(1.0, 2.0)) -> bytes:
    return pack(encode(SampleMessage(Header(3, k, at_us), LAYOUT.number, LAYOUT.content(np.array(values)))))


def listened(chunks: list[tuple[float, bytes]]) -> Listener:
    listener = Listener(SoftfuseFrames())
    for at, data in chunks:
        listener.feed(Chunk(0, START + at, data))
    return listener


@pytest.mark.parametrize(
    ("drift", "largest_error_ppm"), [(-400e-6, 400.0), (0.0, 400.0), (2000e-6, 400.0), (999.0, 5e6)]
)
def test_rate_drift_and_jitter_are_those_of_the_board(drift, largest_error_ppm):
    random = np.random.default_rng(5)
    late = random.exponential(1e-3, 201)
    chunks = [(0.0, described())]
    # A clock that is slow by the drift counts fewer microseconds; one of milliseconds a thousandth.
    chunks += [(0.01 * k + late[k], sample(k, round(1e4 * k / (1 + drift)))) for k in range(201)]
    (heard,) = listened(chunks).heard
    assert (heard.device, heard.samples, heard.channels) == (3, 201, ("a_V", "b_V"))
    assert heard.rate_Hz == pytest.approx(100.0 * (1 + drift), rel=1e-5)
    assert heard.drift_ppm is not None
    found, error = heard.drift_ppm
    # The least of 17 delays of a millisecond, over somewhat less than two seconds.
    assert abs(found - 1e6 * drift) < error < largest_error_ppm
    assert heard.jitter_s == pytest.approx(np.percentile(late, 95), rel=0.15)


@pytest.mark.parametrize("seconds", [1.0, 2.0])
def test_a_stall_of_the_computer_is_not_taken_for_a_drift(seconds):
    random = np.random.default_rng(8)
    told = 0
    for _ in range(200):
        at = 0.01 * np.arange(round(100 * seconds) + 1)
        come = at + random.exponential(1e-3, len(at))
        for _ in range(random.integers(1, 4)):
            start, length = random.uniform(-0.3, 1.0) * seconds, random.uniform(0.0, 0.4)
            # What comes during a stall is read at its end.
            come[(come > start) & (come < start + length)] = start + length
        come = np.maximum.accumulate(come)
        chunks = [(come[0], described())]
        chunks += [(come[k], sample(k, round(1e6 * at[k]))) for k in range(len(at))]
        (heard,) = listened(chunks).heard
        assert heard.rate_Hz == pytest.approx(100.0, rel=1e-5)
        assert heard.drift_ppm is not None
        drift, error = heard.drift_ppm
        # NaN where little is left beside the stalls.
        assert not abs(drift) > error
        told += math.isfinite(drift)
    assert told > 100


def test_what_is_lost_doubled_and_late_is_counted():
    order = [*range(10), 9, *range(12, 20), 11, *range(20, 30)]
    chunks = [(0.0, described()), *((0.01 * i, sample(k, 10_000 * k)) for i, k in enumerate(order))]
    (heard,) = listened(chunks).heard
    assert heard.counts is not None
    assert (heard.counts.lost, heard.counts.duplicated, heard.counts.late) == (1, 1, 1)
    assert heard.samples == 28 and heard.rate_Hz == pytest.approx(100.0, rel=0.05)


def test_only_what_is_wrong_after_the_first_sample_is_a_fault():
    begun = sample(0, 0)[5:]
    clean = listened([(0.0, begun + described() + sample(1, 10_000)), (0.01, sample(2, 20_000))])
    assert clean.faults == {} and clean.bytes > 0
    bad = bytearray(sample(3, 30_000))
    bad[8] ^= 1
    faulty = listened([(0.0, described() + sample(1, 10_000)), (0.01, bytes(bad)), (0.02, sample(4, 40_000))])
    assert sum(faulty.faults[key] for key in ("CRC failures", "COBS failures") if key in faulty.faults) == 1


def test_channels_that_are_never_read_are_named():
    (heard,) = listened(
        [(0.0, described() + sample(0, 0, (1.0, math.nan)) + sample(1, 9, (2.0, math.nan)))]
    ).heard
    assert heard.never_read == ("b_V",)


def test_a_board_is_asked_what_it_is_and_silence_is_nothing():
    listener = Listener(SoftfuseFrames())
    assert listener.heard == [] and listener.first_s is None
    assert listener.feed(Chunk(0, START, sample(0, 0))) != b""
    assert listener.faults == {"samples not described": 1}
    assert listener.feed(Chunk(0, START + 1.0, b"")) == b"" and listener.bytes == len(sample(0, 0))


def test_lines_without_a_time_have_the_rate_of_their_arrivals():
    listener = Listener(TextLines(TextFormat(("x",), None, ",", ""), {"x": "row0"}))
    for k in range(51):
        listener.feed(Chunk(0, START + 0.02 * k, b"17\n"))
    (heard,) = listener.heard
    assert heard.rate_Hz == pytest.approx(50.0, rel=0.05) and heard.drift_ppm is None and heard.counts is None
    assert heard.jitter_s < 1e-6
