"""Sessions read back: bit for bit, in order, cut anywhere, damaged, hostile, or not ours at all."""

import math
import struct
import tracemalloc
import zlib

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.record.session_writer import FORMAT, SessionWriter
from softfuse.hardware.stream import Chunk, Notice

START_S = 1795321061.4256344
MAGIC = b"\x89MCAP0\r\n"
INFO = SessionInfo(
    device="pad",
    command="run",
    started="2026-11-22T04:00:00Z",
    channels=("flow0_V", "row0"),
    estimates={"force_N": "number", "where": "string"},
    sources=(SourceInfo("loop://", "wire"),),
    config=b"x = 1\n",
    version="0.1.0",
)
ABOUT = {"format": FORMAT, "channels": '["a"]', "estimates": "{}", "sources": "0"}


def entries(count):
    """A session of every kind of entry."""
    rng = np.random.default_rng(0)
    for i in range(count):
        at = START_S + 0.01 * i
        yield Chunk(0, at, rng.bytes(30))
        yield FrameEntry(i, at, np.where(rng.random(2) < 0.3, np.nan, rng.normal(size=2)))
        where = "" if i % 3 else "left, 'mid' \"2\"\n"
        status = ("ok", "late")[: i % 3]
        yield EstimateEntry(i, at, at + 1e-3, {"force_N": rng.normal(), "where": where}, status, 1.5, None)
        if i % 7 == 0:
            yield Notice(at, None if i else 0, "warning", f"gap of {i}")


def plain(entry):
    """What can be compared bit for bit."""
    if isinstance(entry, FrameEntry):
        return entry.index, entry.time_s, entry.values.tobytes()
    return entry


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A closed session of several chunks."""
    path = tmp_path_factory.mktemp("session") / "a.mcap"
    with SessionWriter(path, INFO) as writer:
        for k, entry in enumerate(entries(60)):
            writer.add(entry)
            if k % 40 == 39:
                writer.flush()
    return path


def test_everything_comes_back_bit_for_bit_in_the_order_of_writing(whole):
    session = RecordedSession(whole)
    assert session.info == INFO
    assert (session.complete, session.cut_bytes, session.unreadable) == (True, 0, 0)
    assert list(map(plain, session.entries())) == list(map(plain, entries(60)))
    kinds = {Chunk: session.chunks, FrameEntry: session.frames, EstimateEntry: session.estimates}
    for kind, read in {**kinds, Notice: session.notices}.items():
        assert list(map(plain, read())) == [plain(e) for e in entries(60) if isinstance(e, kind)]


@settings(max_examples=60)
@given(
    st.lists(st.lists(st.floats(allow_infinity=False), min_size=3, max_size=3), max_size=5),
    st.lists(st.binary(max_size=50), max_size=4),
)
def test_any_numbers_and_bytes_come_back(tmp_path_factory, rows, blocks):
    path = tmp_path_factory.mktemp("any") / "a.mcap"
    with SessionWriter(path, SessionInfo(channels=("a", "b"), sources=(SourceInfo("", ""),))) as writer:
        for i, (at, *values) in enumerate(rows):
            writer.add(FrameEntry(i, at, np.array(values)))
        for data in blocks:
            writer.add(Chunk(0, START_S, data))
    session = RecordedSession(path)
    found = [[frame.time_s, *frame.values] for frame in session.frames()]
    np.testing.assert_array_equal(np.reshape(found, (-1, 3)), np.reshape(rows, (-1, 3)))
    signs = [math.copysign(1, x) for row in found for x in row if x == 0]
    assert signs == [math.copysign(1, x) for row in rows for x in row if x == 0]
    assert [chunk.data for chunk in session.chunks()] == blocks


def test_cut_at_any_byte_it_is_read_as_far_as_it_goes(whole, tmp_path):
    data = whole.read_bytes()
    expected = list(map(plain, entries(60)))
    path, most = tmp_path / "cut.mcap", 0
    for size in [*range(1200), *range(1200, len(data), 37), *range(len(data) - 200, len(data))]:
        path.write_bytes(data[:size])
        session = RecordedSession(path)
        found = list(map(plain, session.entries()))
        assert found == expected[: len(found)] and session.unreadable == 0
        assert not session.complete and 0 <= session.cut_bytes <= size
        # What is not in the cut bytes has been read.
        assert len(found) >= most
        most = len(found)
    assert most == len(expected)


def test_the_bytes_that_were_cut_are_counted(whole, tmp_path, caplog):
    path = tmp_path / "cut.mcap"
    data = whole.read_bytes()
    path.write_bytes(data[:-1])
    assert RecordedSession(path).cut_bytes == 7
    path.write_bytes(data + b"\0" * 100)
    assert RecordedSession(path).complete
    path.write_bytes(data[: first_chunk(data)] + bytes(4096))
    assert RecordedSession(path).cut_bytes == 4096
    assert "was not closed" in caplog.text


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"time_s,row0\n0,1\n", "no MCAP file"),
        (b"\x89PNG\r\n", "no MCAP file"),
    ],
)
def test_another_kind_of_file_is_refused(tmp_path, data, told):
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=told):
        RecordedSession(path)


def test_a_file_that_is_not_there_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path / "no.mcap", tmp_path):
        with pytest.raises(RecordingError, match="cannot open"):
            RecordedSession(path)


def foreign(path, profile, metadata, messages=(), topics=("/frame",), compression=CompressionType.ZSTD):
    """A file that some other program wrote."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression)
        writer.start(profile=profile, library="other\x1b[31m")
        if metadata is not None:
            writer.add_metadata("softfuse", metadata)
        for topic in topics:
            writer.register_channel(topic, "json", 0)
        for data in messages:
            writer.add_message(1, 0, data, 0)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("profile", "metadata", "told"),
    [
        ("ros2", {}, r"profile 'ros2', written by 'other\\x1b\[31m'"),
        ("x-softfuse", None, "does not describe itself"),
        ("x-softfuse", {**ABOUT, "format": "9"}, "format '9'.*take a newer softfuse"),
        ("x-softfuse", {**ABOUT, "channels": "{}"}, "describes itself wrongly"),
        ("x-softfuse", {**ABOUT, "channels": '["a", "a"]'}, "'a' twice"),
        ("x-softfuse", {**ABOUT, "channels": "[" * 100_000}, "describes itself wrongly"),
        ("x-softfuse", {**ABOUT, "estimates": '{"a": "int"}'}, "describes itself wrongly"),
        ("x-softfuse", {**ABOUT, "sources": "²"}, "describes itself wrongly"),
        ("x-softfuse", {**ABOUT, "sources": "99999999"}, "describes itself wrongly"),
    ],
)
def test_a_file_that_is_no_session_of_ours_is_refused_and_says_what_it_is(tmp_path, profile, metadata, told):
    with pytest.raises(RecordingError, match=told):
        RecordedSession(foreign(tmp_path / "a.mcap", profile, metadata))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[1]",
        b"{}",
        b'{"index": -1}',
        b'{"index": 1.0}',
        b'{"index": true}',
        b'{"index": 1' + b"0" * 30 + b"}",
        b'{"index": 1, "a": NaN}',
        b'{"index": 1, "a": Infinity}',
        b'{"index": 1, "a": ' + b"9" * 5000 + b"}",
        b"[" * 1_000_000,
        b'{"index": 1}' + b" " * (1 << 20),
        b'{"index": 1, "a": "\xff"}',
    ],
)
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.NONE])
def test_an_entry_that_is_none_is_counted_and_the_rest_is_read(tmp_path, data, compression):
    good = b'{"index": 7, "time_s": 1, "a": 2}'
    path = foreign(tmp_path / "a.mcap", "x-softfuse", ABOUT, [good, data, good], compression=compression)
    session = RecordedSession(path)
    assert [frame.index for frame in session.frames()] == [7, 7] and session.unreadable == 1


@pytest.mark.parametrize("value", [b'"3"', b"null", b"true", b"1e999", b"[1]", b"1" + b"0" * 400])
def test_a_value_that_is_no_number_is_missing(tmp_path, value):
    data = b'{"index": 0, "time_s": 1, "a": %s, "b": 3}' % value
    (frame,) = RecordedSession(foreign(tmp_path / "a.mcap", "x-softfuse", ABOUT, [data])).frames()
    assert frame.time_s == 1.0 and math.isnan(frame.values[0])


def test_topics_of_others_are_left_alone(tmp_path):
    topics = ("/tf", "/frame", "/source/01/bytes", "/source/\u0663/bytes")
    session = RecordedSession(foreign(tmp_path / "a.mcap", "x-softfuse", ABOUT, [b"?"], topics))
    assert list(session.entries()) == [] and session.unreadable == 0


def chunk(data, size, compression=b"zstd", crc=0):
    head = struct.pack("<QQQI", 0, 0, size, crc) + struct.pack("<I", len(compression)) + compression
    content = head + struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(content)) + content


BOMB = zstandard.compress(bytes(1 << 28))
HOSTILE = {
    "a size that lies": chunk(BOMB, 100),
    "a bomb that tells its size": chunk(BOMB, 1 << 28),
    "a bomb that tells the largest size": chunk(BOMB, 1 << 26),
    "a size without end": chunk(BOMB, (1 << 64) - 1),
    "no zstd": chunk(b"nothing", 100),
    "nothing": chunk(b"", 100),
    "unknown compression": chunk(b"", 0, b"rar\x1b"),
    "a compression's name that is no text": chunk(b"", 0, b"\xff\xfe"),
    "a wrong CRC": chunk(bytes(9), 9, b"", zlib.crc32(b"other")),
    "a record longer than its chunk": chunk(struct.pack("<BQ", 5, 1 << 60), 9, b""),
    "a message without head": chunk(struct.pack("<BQ", 5, 3) + b"abc", 12, b""),
    "a chunk of 3 bytes": struct.pack("<BQ", 6, 3) + b"abc",
    "a chunk's data without end": struct.pack("<BQ", 6, 40) + chunk(b"", 0, b"")[9:41] + b"\xff" * 8,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_chunk_is_counted_and_costs_little_memory(whole, tmp_path, name):
    data = whole.read_bytes()
    path = tmp_path / "a.mcap"
    begin = first_chunk(data)
    path.write_bytes(data[:begin] + HOSTILE[name] + data[begin:])
    tracemalloc.start()
    try:
        session = RecordedSession(path)
        found = list(map(plain, session.entries()))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found == list(map(plain, entries(60))) and session.unreadable == 1
    assert peak < 150e6


def first(data, opcode):
    """Where the first record of a kind begins and ends."""
    begin = len(MAGIC)
    while True:
        end = begin + 9 + struct.unpack_from("<Q", data, begin + 1)[0]
        if data[begin] == opcode:
            return begin, end
        begin = end


def first_chunk(data):
    """Where the first chunk of a file begins."""
    return first(data, 6)[0]


@pytest.mark.parametrize("opcode", [1, 4, 5, 6, 9, 12])
@pytest.mark.parametrize("length", [1 << 20, 1 << 40, (1 << 64) - 1])
def test_a_record_that_tells_to_be_longer_than_the_file_ends_it(whole, tmp_path, opcode, length):
    data = whole.read_bytes()
    begin = first_chunk(data)
    path = tmp_path / "a.mcap"
    path.write_bytes(data[:begin] + struct.pack("<BQ", opcode, length) + data[begin:])
    session = RecordedSession(path)
    assert not session.complete and list(session.entries()) == [] and session.info == INFO


def test_a_damaged_chunk_loses_its_own_entries_only(whole, tmp_path, caplog):
    data = bytearray(whole.read_bytes())
    data[first_chunk(data) + 200] ^= 1
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    session = RecordedSession(path)
    found = list(map(plain, session.entries()))
    expected = list(map(plain, entries(60)))
    assert session.complete and session.unreadable == 1 and "is damaged" in caplog.text
    assert found == expected[len(expected) - len(found) :] and len(found) == len(expected) - 40


def test_without_its_first_chunk_and_its_end_a_session_tells_that_it_cannot_be_read(whole, tmp_path):
    data = whole.read_bytes()
    begin, end = first(data, 6)
    path = tmp_path / "a.mcap"
    path.write_bytes(data[:begin] + data[end : first(data, 15)[0]])
    session = RecordedSession(path)
    assert list(session.entries()) == [] and session.unreadable == len(list(entries(60))) - 40


def test_2000_damaged_files_raise_nothing_else(whole, tmp_path):
    data = whole.read_bytes()
    rng = np.random.default_rng(1)
    path = tmp_path / "a.mcap"
    read = refused = 0
    for _ in range(2000):
        damaged = bytearray(data)
        # Half of the flips hit the head, where the file describes itself.
        top = len(data) if rng.random() < 0.5 else 900
        for at in rng.integers(0, top, rng.integers(1, 6)):
            damaged[at] = rng.integers(256)
        kind = rng.integers(4)
        begin, end = sorted(rng.integers(0, top, 2).tolist())
        if kind == 1:
            del damaged[begin:end]
        elif kind == 2:
            damaged[begin:begin] = damaged[begin:end]
        elif kind == 3:
            del damaged[end:]
        path.write_bytes(damaged)
        try:
            list(RecordedSession(path).entries())
            read += 1
        except RecordingError as error:
            refused += 1
            assert str(path) in str(error)
    assert read > 500 and refused > 50
