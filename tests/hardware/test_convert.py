"""Frames through all kinds of files, bit for bit, and estimates out of a session."""

import csv
import gzip
import math
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.errors import RecordingError
from softfuse.hardware.record import convert
from softfuse.hardware.record.convert import convert_estimates, convert_frames
from softfuse.hardware.record.entries import EstimateEntry, FrameEntry, SessionInfo, SourceInfo
from softfuse.hardware.record.session_reader import RecordedSession
from softfuse.hardware.record.session_writer import SessionWriter
from softfuse.hardware.recording import read_recording
from softfuse.hardware.stream import Chunk

START_S = 1795321061.4256344
SUFFIXES = (".mcap", ".csv", ".csv.gz", ".parquet")
NUMBERS = st.floats(allow_infinity=False)
CHANNELS = ("flow0_V", "row 0", "Δ_mm", '"q"', "back\\slash;")


def session(path, rows, *, indices=None):
    """A session of frames with some bytes and estimates."""
    info = SessionInfo(
        device="pad",
        started="2026-11-22T04:00:00Z",
        channels=CHANNELS[: len(rows[0]) - 1],
        estimates={"force_N": "number", "contacts": "number", "where": "string"},
        sources=(SourceInfo("loop://", "wire"),),
    )
    with SessionWriter(path, info) as writer:
        for i, (at, *values) in zip(indices or range(len(rows)), rows, strict=True):
            writer.add(Chunk(0, START_S, b"raw"))
            writer.add(FrameEntry(i, at, np.array(values, dtype=float)))
            fields = {"force_N": 0.1 * i, "contacts": i % 2, "where": "left, 2" if i else None}
            writer.add(EstimateEntry(i, at, START_S, fields, ("ok", "late")[:i], 1.25, None, i + 1))
    return path


def bits(path):
    """Time and values of a session's frames as 64 bit patterns, NaN being one."""
    rows = np.array([[frame.time_s, *frame.values] for frame in RecordedSession(path).frames()])
    return np.where(np.isnan(rows), np.nan, rows).tobytes()


ROWS = [
    [START_S, 0.1, 20000.0, -0.0, 1e-308, 5e-324],
    [START_S + 0.01, math.nan, 1 / 3, 1e22, 123456789.123456789, -1.7976931348623157e308],
    [math.nan, math.nan, math.nan, math.nan, math.nan, math.nan],
    [START_S + 0.02, 0.1 + 0.2, 2.0**53 + 2, 0.0, math.pi, -1e16],
]


@pytest.mark.parametrize(
    "route",
    [
        (".mcap", ".csv", ".mcap"),
        (".mcap", ".parquet", ".mcap"),
        (".mcap", ".csv.gz", ".parquet", ".csv", ".parquet", ".mcap"),
        (".mcap", ".CSV", ".csv", ".parquet", ".parquet", ".csv.gz", ".mcap"),
    ],
)
def test_every_number_goes_all_the_way_round(tmp_path, route):
    paths = [tmp_path / f"{k}{suffix}" for k, suffix in enumerate(route)]
    session(paths[0], ROWS)
    for source, target in pairwise(paths):
        assert convert_frames(source, target) == len(ROWS)
    assert bits(paths[-1]) == bits(paths[0])
    info = RecordedSession(paths[-1]).info
    assert info.channels == CHANNELS and info.command == f"convert {paths[-2].name}"
    assert [frame.index for frame in RecordedSession(paths[-1]).frames()] == [0, 1, 2, 3]


@settings(max_examples=40)
@given(
    st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=1, max_size=6), st.sampled_from(SUFFIXES[1:])
)
def test_any_numbers_go_all_the_way_round(tmp_path_factory, rows, suffix):
    folder = tmp_path_factory.mktemp("any")
    first, between, last = folder / "a.mcap", folder / f"b{suffix}", folder / "c.mcap"
    session(first, rows)
    convert_frames(first, between)
    convert_frames(between, last)
    assert bits(last) == bits(first)


def test_a_csv_goes_through_a_session_and_comes_back_the_same(tmp_path):
    text = "time_s,flow0_V,row0,press\n0.0,0.5,20000.0,\n0.01,,20010.5,1.0\n,0.25,1e-07,2.0\n"
    (tmp_path / "a.csv").write_text(text)
    convert_frames(tmp_path / "a.csv", tmp_path / "b.mcap")
    convert_frames(tmp_path / "b.mcap", tmp_path / "c.csv")
    assert (tmp_path / "c.csv").read_text() == text


def test_a_csv_with_spoilt_rows_keeps_what_can_be_read(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,a,b\n0.1,1,2\n0.2,x,4\n0.3,5\n")
    assert convert_frames(tmp_path / "a.csv", tmp_path / "b.mcap") == 3
    values = np.array([frame.values for frame in RecordedSession(tmp_path / "b.mcap").frames()])
    np.testing.assert_array_equal(values, [[1, 2], [np.nan, 4], [np.nan, np.nan]])


def test_a_session_as_csv_is_a_recording(tmp_path):
    convert_frames(session(tmp_path / "a.mcap", ROWS), tmp_path / "b.csv.gz")
    recording = read_recording(tmp_path / "b.csv.gz", CHANNELS)
    np.testing.assert_array_equal(recording.matrix(["time_s", *CHANNELS]), ROWS)
    assert gzip.decompress((tmp_path / "b.csv.gz").read_bytes()).startswith(b"time_s,flow0_V,row 0,")


def test_gaps_in_the_numbers_of_frames_are_kept_by_parquet(tmp_path):
    session(tmp_path / "a.mcap", ROWS, indices=[3, 4, 90, 91])
    convert_frames(tmp_path / "a.mcap", tmp_path / "b.parquet")
    convert_frames(tmp_path / "b.parquet", tmp_path / "c.mcap")
    assert [frame.index for frame in RecordedSession(tmp_path / "c.mcap").frames()] == [3, 4, 90, 91]


def test_parquet_holds_floats_with_nulls_compressed_by_zstd(tmp_path):
    convert_frames(session(tmp_path / "a.mcap", ROWS), tmp_path / "b.parquet")
    table = pq.read_table(tmp_path / "b.parquet")
    assert table.schema.names == ["index", "time_s", *CHANNELS]
    assert set(table.schema.types[1:]) == {pa.float64()} and table.column("flow0_V").null_count == 2
    assert pq.ParquetFile(tmp_path / "b.parquet").metadata.row_group(0).column(0).compression == "ZSTD"


def test_tables_longer_than_a_batch_stay_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr(convert, "_CELLS", 40)
    rows = [[0.01 * i, float(i), -float(i)] for i in range(95)]
    convert_frames(session(tmp_path / "a.mcap", rows), tmp_path / "b.parquet")
    convert_frames(tmp_path / "b.parquet", tmp_path / "c.mcap")
    assert bits(tmp_path / "c.mcap") == bits(tmp_path / "a.mcap")


def test_tables_of_others_are_read(tmp_path):
    columns = {
        "n": pa.array([1, None, 3], pa.int16()),
        "time_s": pa.array([0.0, 0.5, 1.0], pa.float32()),
        "x": pa.chunked_array([pa.array([1.5]), pa.array([math.inf, math.nan])]),
    }
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    convert_frames(tmp_path / "a.parquet", tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == "time_s,n,x\n0.0,1.0,1.5\n0.5,,\n1.0,3.0,\n"


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"a": [1.0]}, "lacks the column 'time_s'"),
        ({"time_s": [1.0], "a": ["x\x1b"]}, "'a' of .* holds string, not numbers"),
        ({"time_s": [1.0], "index": [-1], "a": [1]}, "counted from 0"),
        ({"time_s": [1.0], "index": [0.5], "a": [1]}, "counted from 0"),
        ({"time_s": [1.0]}, "no channels"),
        ({"time_s": [1.0], "a": [2**53 + 1]}, "cannot read .* after row 0"),
    ],
)
def test_a_table_that_holds_no_frames_is_refused(tmp_path, columns, told):
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    with pytest.raises(RecordingError, match=told):
        convert_frames(tmp_path / "a.parquet", tmp_path / "b.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["a.parquet"]


def test_damaged_tables_raise_nothing_else(tmp_path):
    convert_frames(session(tmp_path / "a.mcap", ROWS * 50), tmp_path / "a.parquet")
    data = (tmp_path / "a.parquet").read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        damaged = bytearray(data)
        for at in rng.integers(0, len(data), 4):
            damaged[at] = rng.integers(256)
        (tmp_path / "b.parquet").write_bytes(
            damaged[: rng.integers(1, len(data)) if rng.random() < 0.3 else None]
        )
        try:
            convert_frames(tmp_path / "b.parquet", tmp_path / "c.csv", overwrite=True)
        except RecordingError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 200


def test_estimates_as_csv_and_parquet(tmp_path):
    session(tmp_path / "a.mcap", ROWS[:2])
    assert convert_estimates(tmp_path / "a.mcap", tmp_path / "b.csv") == 2
    assert convert_estimates(tmp_path / "a.mcap", tmp_path / "b.parquet") == 2
    with (tmp_path / "b.csv").open(newline="") as stream:
        first, second = csv.DictReader(stream)
    assert list(first) == [
        *("time_s", "frame", "sensed", "force_N", "contacts", "where"),
        *("latency_ms", "end_to_end_ms", "status"),
    ]
    assert float(first["time_s"]) == START_S and first["where"] == first["end_to_end_ms"] == ""
    assert [*second.values()][1:] == ["1", "2", "0.1", "1", "left, 2", "1.25", "", "ok"]
    rows = pq.read_table(tmp_path / "b.parquet").to_pylist()
    assert rows[0]["where"] is None and rows[1]["where"] == "left, 2" and rows[1]["status"] == ["ok"]
    assert rows[1]["force_N"] == 0.1 and rows[1]["contacts"] == 1.0 and rows[0]["end_to_end_ms"] is None


def test_a_cut_session_is_converted_as_far_as_it_goes(tmp_path, caplog):
    data = session(tmp_path / "a.mcap", ROWS).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[:-30])
    assert convert_frames(tmp_path / "cut.mcap", tmp_path / "b.csv") == 4
    assert "was not closed" in caplog.text


def test_what_cannot_be_converted_is_told(tmp_path):
    path = session(tmp_path / "a.mcap", ROWS)
    (tmp_path / "a.csv").write_text("time_s,a\n0,1\n")
    (tmp_path / "folder.csv").mkdir()
    with SessionWriter(tmp_path / "none.mcap", SessionInfo()):
        pass
    with SessionWriter(tmp_path / "comma.mcap", SessionInfo(channels=("a,b",))):
        pass
    cases = [
        (convert_frames, path, "b.txt", r"must end in \.mcap"),
        (convert_frames, path, "b.mcap", "both sessions"),
        (convert_frames, path, "a.csv", "--force"),
        (convert_frames, path, "no/b.csv", "cannot write"),
        (convert_frames, tmp_path / "no.mcap", "b.csv", "cannot open"),
        (convert_frames, tmp_path / "no.parquet", "b.csv", "cannot read"),
        (convert_frames, tmp_path / "none.mcap", "b.csv", "no channels"),
        (convert_frames, tmp_path / "comma.mcap", "b.csv", "'a,b' cannot be named"),
        (convert_estimates, tmp_path / "none.mcap", "b.csv", "no estimates"),
        (convert_estimates, tmp_path / "a.csv", "b.csv", "taken out of"),
        (convert_estimates, path, "b.mcap", "taken out of"),
    ]
    before = sorted(tmp_path.iterdir())
    for act, source, target, told in cases:
        with pytest.raises(RecordingError, match=told):
            act(source, tmp_path / target)
    with pytest.raises(RecordingError, match="cannot write"):
        convert_frames(path, tmp_path / "folder.csv", overwrite=True)
    assert sorted(tmp_path.iterdir()) == before and (tmp_path / "a.csv").read_text() == "time_s,a\n0,1\n"
    assert convert_frames(path, tmp_path / "a.csv", overwrite=True) == 4
