"""A virtual board: its packets are what a host's decoder reads back, and faults show where they belong."""

import numpy as np
import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.device_clock import DeviceClock
from softfuse.hardware.virtual.board import BoardClock, DeadSensor, SensorFaults, VirtualBoard
from softfuse.hardware.virtual.faults import FaultyLine, LineFaults
from softfuse.hardware.wire.decoder import Decoder, Received
from softfuse.hardware.wire.description import Channel, Description, RawType
from softfuse.hardware.wire.message import (
    AskMessage,
    DescriptionMessage,
    Header,
    SampleMessage,
    encode,
    pack,
)
from softfuse.hardware.wire.sequence import SequenceCounts, SequenceWatch

STEP_V = 3.3 / 4096
DESCRIPTION = Description(
    "bench",
    (
        Channel("flow0_V", RawType.U16, STEP_V, 0.0),
        Channel("row0", RawType.U16, 1.0, 0.0),
        Channel("cable0_mm", RawType.I32, 1e-3, 0.0),
    ),
)
SCALE = np.array([channel.scale for channel in DESCRIPTION.channels])


def read(time_s: np.ndarray) -> np.ndarray:
    """Whole raw values that tell the time."""
    k = np.rint(1000 * np.asarray(time_s))
    return np.stack([k % 4096, k % 60000, -k], axis=1) * SCALE


def board(**options) -> VirtualBoard:
    clock = BoardClock(options.pop("rate", 100.0), options.pop("start_us", 0), options.pop("drift", 0.0))
    return VirtualBoard(7, DESCRIPTION, read, clock, **options)


def decoded(decoder: Decoder, packets: list[bytes]) -> list[Received]:
    return decoder.feed(b"".join(packets), 0.0)


def samples_of(received: list[Received]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sequence numbers (n,), device times (n,) µs, values (n, k)."""
    some = [(one.message.header, one.values) for one in received if isinstance(one.message, SampleMessage)]
    return (
        np.array([header.sequence for header, _ in some]),
        np.array([header.time_us for header, _ in some]),
        np.array([values for _, values in some]),
    )


def test_the_decoder_gets_exactly_what_was_read() -> None:
    device, decoder = board(start_us=123), Decoder()
    received = decoded(decoder, device.switch_on(0.0) + device.take(350))
    sequence, time_us, values = samples_of(received)
    np.testing.assert_array_equal(sequence, np.arange(350))
    np.testing.assert_array_equal(time_us, 123 + 10_000 * np.arange(350))
    np.testing.assert_array_equal(values, read(np.arange(350) / 100))
    described = [one.message for one in received if isinstance(one.message, DescriptionMessage)]
    assert [one.header.time_us for one in described] == [123 + 1_000_000 * k for k in range(4)]
    assert [one.header.sequence for one in described] == [0, 100, 200, 300]
    assert {one.description for one in described} == {DESCRIPTION}
    counts = decoder.counts
    assert counts.samples == device.counts.samples == 350
    assert counts.line.packets == 354 and counts.line.bytes_discarded == 0
    assert (counts.undescribed, counts.malformed, counts.unknown_kind, counts.unknown_version) == (0,) * 4


def test_it_does_not_matter_how_many_are_taken_at_once() -> None:
    whole, pieces = board(faults=SensorFaults(lost=0.3)), board(faults=SensorFaults(lost=0.3))
    together = whole.switch_on(0.0) + whole.take(700)
    apart = pieces.switch_on(0.0) + [packet for n in (1, 2, 3, 94, 600) for packet in pieces.take(n)]
    assert together == apart


def test_a_question_is_answered_by_whom_it_is_for() -> None:
    device = board()
    device.switch_on(0.0)
    device.take(42)
    others, own, all_of_them = (pack(encode(AskMessage(Header(k, 0, 0)))) for k in (8, 7, 65535))
    assert device.hear(others + b"noise\0") == []
    question = own + all_of_them
    assert device.hear(question[:5]) == []
    answers = device.hear(question[5:])
    received = decoded(Decoder(), answers)
    assert len(received) == 2
    for one in received:
        assert isinstance(one.message, DescriptionMessage) and one.message.header.sequence == 42
    assert device.counts.answers == 2


def test_samples_are_due_when_their_time_has_come() -> None:
    device = board(rate=100.0)
    device.switch_on(5.0)
    assert [device.due(t) for t in (4.9, 5.0, 5.0099, 5.0101, 5.5001)] == [0, 1, 1, 2, 51]
    device.take(51)
    assert device.due(5.5001) == 0 and device.next_s == pytest.approx(5.51)


@pytest.mark.parametrize("drift", [-3000.0, 0.0, 0.1, 3000.0])
def test_due_agrees_with_the_times_of_samples(drift: float) -> None:
    clock = BoardClock(333.0, 0, drift)
    for sample in (0, 1, 999, 123_456_789):
        at = clock.true_s(sample)
        assert clock.due(at) == sample + 1
        assert clock.due(np.nextafter(at, -1.0)) == sample


def test_lost_samples_are_gaps_and_nothing_else() -> None:
    device, decoder, watch = board(faults=SensorFaults(lost=0.1)), Decoder(), SequenceWatch()
    sequence, time_us, values = samples_of(decoded(decoder, device.switch_on(0.0) + device.take(2000)))
    for number, at in zip(sequence.tolist(), time_us.tolist(), strict=True):
        watch.place(number, at)
    lost = 2000 - len(sequence)
    assert 150 < lost < 250 and device.counts.lost == lost
    first, last = int(sequence[0]), int(1999 - sequence[-1])
    assert watch.counts == SequenceCounts(2000 - lost, lost - first - last, 0, 0, 0)
    np.testing.assert_array_equal(values, read(sequence / 100))
    counts = decoder.counts
    assert counts.line.bytes_discarded == counts.undescribed == counts.malformed == 0


def test_a_drifting_clock_is_seen_as_one() -> None:
    device, clock = board(drift=250.0), DeviceClock()
    decoder = Decoder()
    device.switch_on(0.0)
    for now in np.arange(0.0, 30.0, 0.0007):
        _, times, _ = samples_of(decoded(decoder, device.take(device.due(now))))
        for time_us in times.tolist():
            clock.stamp(time_us, 1e9 + now)
    # Fast by the device's own count is slow-positive by the host's.
    assert clock.report.drift_ppm == pytest.approx(-250.0, abs=5.0)
    assert clock.report.jumps == clock.report.restarts == 0


def test_a_restart_begins_anew() -> None:
    device, decoder, watch = board(start_us=50), Decoder(), SequenceWatch()
    packets = device.switch_on(0.0) + device.take(300) + device.switch_on(4.0) + device.take(100)
    sequence, time_us, values = samples_of(decoded(decoder, packets))
    for number, at in zip(sequence.tolist(), time_us.tolist(), strict=True):
        watch.place(number, at)
    assert watch.counts == SequenceCounts(fresh=400, lost=0, duplicated=0, late=0, restarted=1)
    np.testing.assert_array_equal(values[300:], read(4.0 + np.arange(100) / 100))
    assert device.counts.power_ons == 2


@pytest.mark.parametrize("silent", [True, False])
@pytest.mark.parametrize("taken", [(300,), (1,) * 300])
def test_a_dead_sensor_dies_alone(silent: bool, taken: tuple[int, ...]) -> None:
    dead = DeadSensor("row0", from_s=1.0, silent=silent)
    device, decoder = board(faults=SensorFaults(dead=(dead,))), Decoder()
    packets = device.switch_on(0.0) + [packet for n in taken for packet in device.take(n)]
    _, _, values = samples_of(decoded(decoder, packets))
    expected = read(np.arange(300) / 100)
    expected[100:, 1] = np.nan if silent else expected[99, 1]
    np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize(
    "faults", [LineFaults(drop=3e-4), LineFaults(flip=5e-5), LineFaults(drop=2e-4, flip=2e-5)]
)
def test_a_bad_line_costs_packets_that_fail_and_gaps(faults: LineFaults) -> None:
    device, line = board(), FaultyLine(faults, (1, 2))
    decoder, clean, watch = Decoder(), Decoder(), SequenceWatch()
    packets = device.switch_on(0.0) + device.take(20_000)
    through = [line.carry(packet) for packet in packets]
    sequence, time_us, values = samples_of(decoder.feed(b"".join(through), 0.0))
    sent = samples_of(clean.feed(b"".join(packets), 0.0))
    kept = np.isin(sent[0], sequence)
    # What arrives is right, to the bit; the rest is missing.
    np.testing.assert_array_equal(sequence, sent[0][kept])
    np.testing.assert_array_equal(values, sent[2][kept])
    for number, at in zip(sequence.tolist(), time_us.tolist(), strict=True):
        watch.place(number, at)
    edges = int(sequence[0]) + int(sent[0][-1] - sequence[-1])
    assert watch.counts == SequenceCounts(len(sequence), 20_000 - len(sequence) - edges, 0, 0, 0)
    spoiled = sum(a != b for a, b in zip(packets, through, strict=True))
    failed = decoder.counts.line.crc_failures + decoder.counts.line.cobs_failures
    gone = 20_000 - len(sequence)
    assert 50 < gone <= 2 * spoiled and 0.5 * spoiled < failed < 2 * spoiled
    assert line.dropped + line.flipped >= spoiled
    counts = decoder.counts
    assert counts.undescribed == counts.malformed == counts.unknown_kind == counts.unknown_version == 0


def test_a_line_drops_and_flips_as_often_as_it_should_and_repeats_itself() -> None:
    data = bytes(range(256)) * 4000
    rare = LineFaults(drop=1e-3, flip=1e-4)
    pieces = [data[k : k + 1000] for k in range(0, len(data), 1000)]
    one, two, other = (FaultyLine(rare, (seed,)) for seed in (3, 3, 4))
    carried = [b"".join(line.carry(piece) for piece in pieces) for line in (one, two, other)]
    assert carried[0] == carried[1] != carried[2]
    assert len(carried[0]) == len(data) - one.dropped
    assert one.dropped == pytest.approx(1e-3 * len(data), rel=0.1)
    assert one.flipped == pytest.approx(8e-4 * len(data), rel=0.1)
    assert FaultyLine(LineFaults(), (3,)).carry(data) == data


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: LineFaults(drop=0.6),
        lambda: LineFaults(flip=float("nan")),
        lambda: SensorFaults(lost=1.0),
        lambda: BoardClock(0.5),
        lambda: BoardClock(float("inf")),
        lambda: BoardClock(100.0, drift_ppm=float("nan")),
    ],
)
def test_impossible_faults_are_refused(wrong) -> None:
    with pytest.raises(HardwareError):
        wrong()
