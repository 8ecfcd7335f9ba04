"""The file of a session: as any reader of MCAP sees it, when it reaches the disk, and what it refuses."""

import json
import math
import re
import subprocess
import sys
import time
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.stream_reader import StreamReader

from softfuse.errors import RecordingError
from softfuse.hardware.record import session_writer
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.record.session_writer import SessionWriter, nanoseconds
from softfuse.hardware.stream import Chunk, HostClock, Notice

START_S = 1795321061.4256344
INFO = SessionInfo(
    device="pad",
    command="run",
    started="2026-11-22T04:00:00Z",
    channels=("flow0_V", "row0", "druck_κ"),
    estimates={"force_N": "number", "contacts": "number", "where": "string"},
    sources=(SourceInfo("/dev/ttyACM0", "wire"), SourceInfo("socket://localhost:1", "lines")),
    config=b"[device]\nname = 'pad'\n",
)
CHECKS = {
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "string": lambda value: isinstance(value, str),
    "array": lambda value: isinstance(value, list),
}


def write(writer, i):
    """What one frame of a live session adds."""
    at = START_S + 0.01 * i
    writer.add(Chunk(i % 2, at, bytes([i % 256, 0, 255]) * 20))
    values = np.array([0.5 + 1e-3 * math.sin(i), 20000.0 + i, math.nan if i % 3 else 1 / 3])
    writer.add(FrameEntry(i, at, values))
    fields = {"force_N": 0.1 * i, "contacts": 1, "where": "left 2" if i % 2 else None}
    writer.add(EstimateEntry(i, at, at + 0.002, fields, ("ok", "late"), 1.5, math.nan, 1))


def obeys(value, schema):
    """Whether an object obeys the part of JSON schema that sessions use."""
    fields = schema["properties"]
    assert schema["type"] == "object" and schema["additionalProperties"] is False
    assert set(schema["required"]) <= set(value) <= set(fields)
    for name, found in value.items():
        field = fields[name]
        assert CHECKS[field["type"]](found), (name, found)
        assert found in field.get("enum", [found])
        assert not CHECKS["number"](found) or found >= field.get("minimum", -math.inf)
        for item in found if field["type"] == "array" else []:
            assert CHECKS[field["items"]["type"]](item)
    return True


@pytest.fixture
def path(tmp_path):
    found = tmp_path / "a.mcap"
    with SessionWriter(found, INFO) as writer:
        for i in range(200):
            write(writer, i)
        writer.add(Notice(START_S, 1, "warning", "lost \x1b[31m"))
        writer.add(Notice(START_S, None, "info", "closed"))
    return found


@pytest.mark.parametrize("reader", [SeekingReader, NonSeekingReader])
def test_any_reader_of_mcap_finds_every_message_and_its_schema(path, reader):
    with path.open("rb") as stream:
        found = list(reader(stream, validate_crcs=True).iter_messages(log_time_order=False))
    topics = [channel.topic for _, channel, _ in found]
    counts = {"/source/0/bytes": 100, "/source/1/bytes": 100, "/frame": 200, "/estimate": 200, "/notice": 2}
    assert {topic: topics.count(topic) for topic in topics} == counts
    for schema, channel, message in found:
        assert message.log_time == message.publish_time >= int(START_S * 1e9)
        if schema is None:
            assert channel.message_encoding == "application/octet-stream" and len(message.data) == 60
        else:
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
            assert obeys(json.loads(message.data), json.loads(schema.data))


def test_a_schema_has_one_type_a_field_since_foxglove_takes_no_other(path):
    with path.open("rb") as stream:
        schemas = SeekingReader(stream).get_summary().schemas.values()
        fields = {name: f for s in schemas for name, f in json.loads(s.data)["properties"].items()}
    assert all(isinstance(field["type"], str) for field in fields.values())
    assert {"flow0_V", "druck_κ", "force_N", "where", "status", "latency_ms", "text"} <= set(fields)


def test_the_file_describes_itself(path):
    with path.open("rb") as stream:
        reader = SeekingReader(stream)
        assert reader.get_header().profile == "x-softfuse"
        metadata = {found.name: found.metadata for found in reader.iter_metadata()}
        (config,) = reader.iter_attachments()
    assert metadata["softfuse"]["device"] == "pad" and metadata["softfuse"]["command"] == "run"
    assert metadata["source/1"] == {"url": "socket://localhost:1", "driver": "lines"}
    assert (config.name, config.data) == ("config.toml", INFO.config)


def test_what_is_missing_is_left_out_of_the_json(path):
    with path.open("rb") as stream:
        frames = list(StreamReader(stream).records)
        stream.seek(0)
        found = NonSeekingReader(stream).iter_messages(topics=["/frame"], log_time_order=False)
        first, second = (
            json.loads(message.data) for _, (_, _, message) in zip(range(2), found, strict=False)
        )
    assert frames and "druck_κ" in first and "druck_κ" not in second
    assert second == {"index": 1, "time_s": START_S + 0.01, "flow0_V": second["flow0_V"], "row0": 20001.0}


@given(st.one_of(st.floats(2.0**23, 1.8e10), st.floats(1.5e9, 2.5e9)))
def test_a_time_since_the_epoch_comes_back_bit_for_bit(at):
    assert nanoseconds(at) / 1_000_000_000 == at


@given(st.floats(0.0, 1.8e10))
def test_any_time_is_kept_to_half_a_nanosecond(at):
    assert abs(nanoseconds(at) - 1_000_000_000 * Fraction(at)) <= Fraction(0.5 + 1e-6)


@pytest.mark.parametrize("at", [-1.0, 1.9e10])
def test_a_time_that_mcap_cannot_hold_is_refused(at):
    with pytest.raises(ValueError, match="count from the epoch"):
        nanoseconds(at)


def test_the_hosts_clock_is_the_calendars_and_never_goes_back():
    clock = HostClock()
    times = [clock.now_s() for _ in range(1000)]
    assert times == sorted(times) and abs(times[-1] - time.time()) < 1.0


def test_half_a_second_after_it_was_added_an_entry_is_on_disk(tmp_path, monkeypatch):
    now = 100.0
    monkeypatch.setattr(session_writer.time, "monotonic", lambda: now)
    path = tmp_path / "a.mcap"
    with SessionWriter(path, INFO) as writer:
        head = path.stat().st_size
        for i in range(500):
            now = 100.0 + 0.01 * i
            write(writer, i)
            if i == 40:
                assert path.stat().st_size == head
            if i >= 51:
                assert len(list(RecordedSession(path).frames())) >= i - 50
        writer.flush()
        found = RecordedSession(path)
        assert len(list(found.frames())) == 500 and not found.complete and found.cut_bytes == 0


def test_an_existing_file_is_not_overwritten(path):
    before = path.read_bytes()
    with pytest.raises(RecordingError, match=r"a\.mcap exists and is not overwritten"):
        SessionWriter(path, INFO)
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", ["no/folder.mcap", "."])
def test_a_place_that_cannot_be_written_is_told(tmp_path, name):
    with pytest.raises(RecordingError, match="cannot write|exists"):
        SessionWriter(tmp_path / name, INFO)


def test_what_does_not_belong_to_the_session_is_refused_and_the_rest_goes_on(tmp_path):
    at = START_S
    with SessionWriter(tmp_path / "a.mcap", INFO) as writer:
        for wrong in (
            lambda: writer.add(Chunk(2, at, b"")),
            lambda: writer.add(Chunk(-1, at, b"")),
            lambda: writer.add(FrameEntry(0, at, np.zeros(2))),
            lambda: writer.add(EstimateEntry(0, at, at, {"nothing": 1.0})),
            lambda: writer.add(EstimateEntry(0, at, at, {"force_N": "much"})),
            lambda: writer.add(EstimateEntry(0, at, at, {"where": 1.0})),
            lambda: writer.add(Notice(at, None, "info", "x" * (1 << 20))),
        ):
            with pytest.raises(ValueError):
                wrong()
        write(writer, 0)
    assert len(list(RecordedSession(tmp_path / "a.mcap").entries())) == 3
    writer.close()
    with pytest.raises(ValueError, match="is closed"):
        write(writer, 1)


@pytest.mark.parametrize(
    ("info", "told"),
    [
        ({"channels": ("a", "b", "a")}, "'a' twice"),
        ({"channels": ("time_s",)}, "'time_s'"),
        ({"channels": ("index",)}, "'index'"),
        ({"channels": ("\ud800",)}, "UTF-8"),
        ({"estimates": {"status": "string"}}, "'status'"),
        ({"channels": tuple(map(str, range(70000)))}, "at most"),
    ],
)
def test_names_that_a_session_cannot_hold_are_refused(info, told):
    with pytest.raises(RecordingError, match=told):
        SessionInfo(**info)


def test_a_frame_without_time_or_before_the_epoch_keeps_its_place(tmp_path):
    times = [0.01, math.nan, -3.0, 1e300, 0.02]
    with SessionWriter(tmp_path / "a.mcap", SessionInfo(channels=("a",))) as writer:
        for i, at in enumerate(times):
            writer.add(FrameEntry(i, at, np.array([1.0])))
    found = list(RecordedSession(tmp_path / "a.mcap").frames())
    np.testing.assert_array_equal([frame.time_s for frame in found], times)


def test_text_with_half_a_surrogate_pair_does_not_stop_the_session(tmp_path):
    info = SessionInfo(command="run caf\udce9.toml", channels=("a",))
    with SessionWriter(tmp_path / "a.mcap", info) as writer:
        writer.add(Notice(START_S, None, "info", "bad \ud800"))
    (notice,) = RecordedSession(tmp_path / "a.mcap").notices()
    assert notice.text == "bad ?"


def test_memory_does_not_grow_with_the_session(tmp_path):
    sizes = []
    tracemalloc.start()
    try:
        with SessionWriter(tmp_path / "a.mcap", INFO) as writer:
            for i in range(8000):
                write(writer, i)
                if i % 50 == 49:
                    writer.flush()
                if i in (1999, 7999):
                    sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    # The index of the 120 chunks that a minute makes, and nothing of the 24,000 entries in them.
    assert sizes[1] - sizes[0] < 120 * 2000


def test_the_reader_of_the_viewer_finds_no_fault(tmp_path):
    with SessionWriter(tmp_path / "a.mcap", INFO) as writer:
        for i in range(100):
            write(writer, i)
        writer.add(Notice(START_S, 0, "info", "open"))
    command = [sys.executable, "-m", "rerun", "mcap", "check", "--full", str(tmp_path / "a.mcap")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for topic in ("/frame", "/estimate", "/notice", "/source/0/bytes", "/source/1/bytes"):
        assert re.search(rf"^ok .* {topic} ", done.stdout, re.MULTILINE), done.stdout
