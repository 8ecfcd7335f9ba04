"""Tables of readings in all the ways in which programs write them, found or told."""

import codecs
import gzip
import logging
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from softfuse.errors import RecordingError
from softfuse.hardware.record.convert import convert_frames
from softfuse.hardware.recording import Recording, read_recording
from softfuse.hardware.table import rows
from softfuse.hardware.table.dialect import time_name
from softfuse.robot.recording import RecordingSettings

N = 12
TIME = np.arange(N) / 100
A, B = np.arange(N) / 8, 1000.0 - np.arange(N)


def written(tmp_path, text: str, *, encoding: str = "utf-8", name: str = "r.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def lines(header: str, form: str, *, end: str = "\n", before: str = "") -> str:
    """A table of N rows: time in s, ms and µs, a and b."""
    body = (form.format(t=t, ms=1e3 * t, us=1e6 * t, a=a, b=b) for t, a, b in zip(TIME, A, B, strict=True))
    return before + end.join([header, *body]) + end


def comma(text: str) -> str:
    return text.replace(".", ",")


def same(recording: Recording) -> None:
    np.testing.assert_array_equal(recording.time_s, TIME)
    np.testing.assert_array_equal(recording.matrix(["a", "b"]), np.stack([A, B], axis=1))
    assert not recording.malformed.any() and not recording.disordered.any()


PREAMBLE = "###  Date-- 01/02/2026\tClock-- 12:0:0\n### s0:hi=48000,lo=4400\nBy, somebody\nrate,100\n\n"


@pytest.mark.parametrize(
    "text",
    [
        lines("time_s,a,b", "{t:.2f},{a},{b}"),
        lines('"time_s","a","b"', "{t:.2f},{a},{b}"),
        lines('"time_s","a","b"', '"{t:.2f}","{a}","{b}"', end="\r\n"),
        lines("'time_s','a','b'", "{t:.2f},'{a}','{b}'"),
        lines("time_s;a;b", "{t:.2f};{a};{b}"),
        lines("time_s\ta\tb", "{t:.2f}\t{a}\t{b}"),
        lines("time_s|a|b", "{t:.2f}|{a}|{b}"),
        lines("time_s a   b", "{t:.2f}   {a} {b} "),
        lines("  time_s   a   b", "  {t:.2f}\t{a} {b}"),
        lines("time_s, a, b", "{t:.2f}, {a}, {b}"),
        lines("time_s,a,b", "{t:.2f},{a},{b}", end="\r"),
        comma(lines("time_s;a;b", "{t:.2f};{a};{b}")),
        comma(lines("time_s\ta\tb", "{t:.2f}\t{a}\t{b}")),
        lines("time_s,a,b", "{t:.2f},{a},{b}").replace("time", "#time"),
        lines("# time_s a b", "{t:.18e} {a:.18e} {b:.18e}"),
        lines("time_s,a,b", "{t:.2f},{a},{b}", before="# one\n# two, three\n"),
        lines("time_s,a,b", "{t:.2f},{a},{b}", before=PREAMBLE),
        lines("Time [s];a;b", "{t:.2f};{a};{b}", before="rate;100\nSensor;pad\n"),
        lines("time;a;b\n[s];[V];[mm]", "{t:.2f};{a};{b}"),
        lines("time,a,b\ns,V,mm", "{t:.2f},{a},{b}"),
        lines("time,a,b\nms,V,mm", "{ms:.0f},{a},{b}"),
        lines("time,a,b", "{t:.2f},{a},{b}"),
        lines("time_ms,a,b", "{ms:.0f},{a},{b}"),
        lines("b,Time (ms),a", "{b},{ms:.3f},{a}"),
        lines("a,b,timestamp [µs]", "{a},{b},{us:.0f}"),
        lines("micros;a;b", "{us:.0f};{a};{b}"),
        lines("time_s,a,b,", "{t:.2f},{a},{b},"),
        lines("time_s,a,b", "{t:.2f},{a},{b},"),
        lines("time_s;a;b;", "{t:.2f};{a};{b}"),
        lines("time_s\ta\tb\t", "{t:.2f}\t{a}\t{b}\t"),
        lines("time_s,a,state,b", "{t:.2f},{a},touch,{b}"),
        lines("state,time_s,a,b,remark", '"touch, hard",{t:.2f},{a},{b},"he said ""so"""'),
        lines(",time_s,a,b,,", ",{t:.2f},{a},{b},,x"),
        lines("time_s,a,b", "{t:.2f},{a},{b}").replace("0.05,", "# a remark\n\n0.05,"),
    ],
)
def test_the_dialect_is_found(tmp_path, text):
    same(read_recording(written(tmp_path, text), ["a", "b"]))
    convert_frames(tmp_path / "r.csv", tmp_path / "c.csv")
    again = read_recording(tmp_path / "c.csv", ["a", "b"])
    same(again)
    assert again.columns.keys() == {"time_s", "a", "b"}


@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", b""),
        ("utf-8-sig", b""),
        ("utf-16", b""),
        ("utf-16-le", codecs.BOM_UTF16_LE),
        ("utf-16-be", codecs.BOM_UTF16_BE),
        ("utf-16-le", b""),
        ("utf-16-be", b""),
        ("utf-32", b""),
        ("cp1252", b""),
    ],
)
def test_the_encoding_is_found(tmp_path, encoding, mark):
    data = mark + lines("time_s;a;b;Wärme [°C]", "{t:.2f};{a};{b};20").encode(encoding)
    for name, content in (("r.csv", data), ("r.csv.gz", gzip.compress(data))):
        (tmp_path / name).write_bytes(content)
        recording = read_recording(tmp_path / name, ["a", "b", "Wärme [°C]"])
        same(recording)
        assert set(recording.columns["Wärme [°C]"]) == {20.0}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (lines("when,a,b", "{ms:.0f},{a},{b}"), RecordingSettings(time="when", time_unit="ms")),
        (lines("time_s,a,b", "{ms:.0f},{a},{b}"), RecordingSettings(time_unit="ms")),
        (lines("a,b", "{a},{b}"), RecordingSettings(rate="100 Hz")),
        (lines("time_s,a,b", "7,{a},{b}"), RecordingSettings(rate="100 Hz")),
        (
            lines("time_s,P1 [V],P2 [V]", "{t},{a},{b}"),
            RecordingSettings(columns={"P1 [V]": "a", "P2 [V]": "b"}),
        ),
        (lines("time_s,b,a", "{t},{a},{b}"), RecordingSettings(columns={"a": "b", "b": "a"})),
        (lines("time_s:a:b", "{t}:{a}:{b}"), RecordingSettings(separator=":")),
        (comma(lines("time_s;a;b", "{t};{a};{b}")), RecordingSettings(separator=";", decimal=",")),
    ],
)
def test_what_is_told_holds(tmp_path, text, told):
    same(read_recording(written(tmp_path, text), ["a", "b"], told))


@pytest.mark.parametrize(
    ("text", "told", "words"),
    [
        (lines("a,b", "{a},{b}"), RecordingSettings(), ["'time_s'", "it has: a, b", "tell the rate"]),
        (lines("time_s,b", "{t},{b}"), RecordingSettings(), ["lacks the column 'a'", "time_s, b"]),
        (lines("time_s,b", "{t},{b}"), RecordingSettings(columns={"P": "a"}), ["lacks the column 'P'"]),
        (lines("time_s,a,a", "{t},{a},{b}"), RecordingSettings(), ["'a' twice"]),
        (lines("time_s;a;b", "{t};{a};{b}"), RecordingSettings(separator=","), ["tell the separator"]),
        (
            lines("time_s,a", "2026-01-01T00:00:{t},{a}"),
            RecordingSettings(),
            ["no numbers in the column 'time_s'"],
        ),
        (lines("time_s,a", "{t},{a}"), RecordingSettings(layout="long"), ["'id'", "'value'"]),
        ("PK\x03\x04....", RecordingSettings(), ["export it as CSV"]),
    ],
)
def test_what_is_wrong_is_told_in_a_line(tmp_path, text, told, words):
    with pytest.raises(RecordingError) as error:
        read_recording(written(tmp_path, text), ["a"], told)
    for word in [*words, "r.csv"]:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "unit_s", "words"),
    [
        (lines("time_s,a,b", "{ms:.0f},{a},{b}"), 1e3, 'steps by 10 s, .* time_unit = "ms" if it is in ms'),
        (lines("time_ms,a,b", "{t},{a},{b}"), 1e-3, 'steps by 1e-05 s, .* time_unit = "s" if it is in s'),
        (lines("time,a,b", "{ms:.0f},{a},{b}"), 1.0, "taken to be ms"),
        (lines("t,a,b", "{us:.0f},{a},{b}"), 1.0, "taken to be us"),
    ],
)
def test_an_interval_that_cannot_be_is_told(tmp_path, caplog, text, unit_s, words):
    recording = read_recording(written(tmp_path, text), ["a"])
    np.testing.assert_allclose(recording.time_s, unit_s * TIME, rtol=1e-12)
    assert len([one for one in caplog.records if "sampling" in one.message or "taken" in one.message]) == 1
    assert re.search(words, caplog.text)


def test_names_of_times_are_told_from_others():
    for name in ("time_s", "Time [ms]", "t", "t_ms", "timestamp", "Time(us)", "millis", "Elapsed Time (s)"):
        assert time_name(name), name
    for name in ("T", "s", "", "force_s", "s0_values", "T [K]", "temperature", "a_ms", "flow0_V"):
        assert not time_name(name), name


def test_texts_where_no_number_is_needed_are_labels(tmp_path, caplog):
    text = "time_s,a,where,state\n0.00,1,,ok\n0.01,2,tip,ok\n0.02,3,-1,bad\n0.03,4,palm,\n0.04,5,2,ok\n"
    recording = read_recording(written(tmp_path, text), ["a"])
    assert not recording.malformed.any() and "state" not in recording.columns
    np.testing.assert_array_equal(recording.columns["where"], [np.nan, np.nan, -1, np.nan, 2])
    state = recording.labels["state"]
    states = [state.texts[code] if code >= 0 else None for code in state.code]
    assert states == ["ok", "ok", "bad", None, "ok"]
    numbers = recording.numbered("where", ["palm", "left", "right"], unknown=-1)
    np.testing.assert_array_equal(numbers, [np.nan, -1, -1, 0, 2])
    assert "'where' says 'tip', which is none of palm, left, right" in caplog.text
    part = recording.rows(np.array([1, 3]))
    assert part.labels["where"].code.tolist() == recording.labels["where"].code[[1, 3]].tolist()


def test_blank_truth_is_told_and_makes_no_row_malformed(tmp_path, caplog):
    text = "time_s,a,sample,true_x_mm,true_force_N\n0.00,1,0,,\n0.01,2,1,5,2\n0.02,3,2,,4\n0.03,4,2,x,4\n"
    recording = read_recording(written(tmp_path, text), ["a"])
    assert not recording.malformed.any()
    assert "'true_x_mm' is blank in 1 samples: they have no such truth (line 4)" in caplog.text
    assert "'true_x_mm' holds text in 1 rows, such as 'x'" in caplog.text
    assert "true_force_N" not in caplog.text


def test_what_a_sensor_lacks_is_told_with_lines(tmp_path, caplog):
    text = "time_s,a,b\n0.00,1,1\n0.01,,1\n0.02,nan,1\n0.03,x,\n0.04,1\n"
    recording = read_recording(written(tmp_path, text), ["a", "b"])
    assert recording.malformed.tolist() == [False, True, True, True, True]
    assert "4 rows have fields that cannot be read: a in 4, b in 2 (lines 3, 4, 5, 6)" in caplog.text


def long(*rows: tuple[float, str, float], header: str = "time_s,id,value") -> str:
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


SHARED = [(t, name, v) for t, a, b in zip(TIME, A, B, strict=True) for name, v in (("a", a), ("b", b))]
APART = [(round(t + d, 3), name, v) for (t, name, v), d in zip(SHARED, [0, 0.004] * N, strict=True)]


def test_a_row_for_each_reading_is_found_and_pivoted(tmp_path):
    recording = read_recording(written(tmp_path, long(*SHARED)), ["b", "a"])
    same(recording)
    assert recording.line.tolist() == list(range(2, 2 + 2 * N, 2))
    assert convert_frames(tmp_path / "r.csv", tmp_path / "c.csv") == N
    same(read_recording(tmp_path / "c.csv", ["a", "b"]))


def test_readings_at_times_of_their_own_share_a_frame(tmp_path):
    kept = [row for k, row in enumerate(APART) if k not in (4, 9)]
    recording = read_recording(written(tmp_path, long(*kept)), ["a", "b"])
    a, b, time = A.copy(), B.copy(), TIME + 0.004
    a[2] = b[4] = np.nan
    time[4] = 0.04
    np.testing.assert_array_equal(recording.matrix(["a", "b"]), np.stack([a, b], axis=1))
    np.testing.assert_allclose(recording.time_s, time, atol=1e-12)


def test_a_long_table_may_be_told(tmp_path):
    numbered = [(1e3 * t, {"a": 0, "b": 1}[name], v) for t, name, v in SHARED]
    called = {"0": "a", "1": "b"}
    told = RecordingSettings(layout="long", time="at", time_unit="ms", id="box", value="x", columns=called)
    path = written(tmp_path, long(*numbered, header="at,box,x"))
    same(read_recording(path, ["a", "b"], told))
    ordered = "\n".join(["box,x", *(f"{name},{v}" for _, name, v in SHARED)]) + "\n"
    told = RecordingSettings(rate="100 Hz", layout="long", id="box", value="x")
    same(read_recording(written(tmp_path, ordered), ["a"], told))


def test_a_channel_that_never_comes_in_a_long_table_is_missing(tmp_path):
    with pytest.raises(RecordingError, match="lacks the column 'c'; it has: a, b"):
        read_recording(written(tmp_path, long(*SHARED)), ["a", "c"])


def test_blocks_and_damages_do_not_matter(tmp_path, monkeypatch):
    rng = np.random.default_rng(3)
    values = rng.normal(size=(5000, 3)).round(4)
    text = [f"{k / 1000:.3f},{a},{b},{c},fine" for k, (a, b, c) in enumerate(values.tolist())]
    text[100], text[2000], text[4999] = "0.1,1", '2.0,"1,2,3', "4.999,,2,3,4,5"
    path = written(tmp_path, "\n".join(["time_s,a,b,c,state", *text]) + "\n")
    whole = read_recording(path, ["a", "b", "c"])
    assert np.flatnonzero(whole.malformed).tolist() == [100, 2000, 4999]
    good = ~whole.malformed
    np.testing.assert_array_equal(whole.matrix(["a", "b", "c"])[good], values[good])
    assert whole.line.tolist() == list(range(2, 5002))
    monkeypatch.setattr("softfuse.hardware.table.rows.HEAD", 1000)
    monkeypatch.setattr("softfuse.hardware.table.rows.BLOCK", 3000)
    parts = read_recording(path, ["a", "b", "c"])
    np.testing.assert_array_equal(parts.matrix(["a", "b", "c"]), whole.matrix(["a", "b", "c"]))
    np.testing.assert_array_equal(parts.malformed, whole.malformed)
    assert parts.labels["state"].code.tolist() == whole.labels["state"].code.tolist()


FIELDS = st.one_of(
    st.floats().map(repr), st.sampled_from(["", "nan", "x", "-", " 3", "+4", "1e5", "0x1", "1_0"])
)


@given(table=st.lists(st.lists(FIELDS, min_size=1, max_size=4), min_size=1, max_size=12))
@example(table=[[" 3"]] * 4)
def test_the_fast_and_the_slow_way_say_the_same(table, tmp_path_factory):
    folder = tmp_path_factory.mktemp("t")
    text = "time_s,a,b\n" + "\n".join(",".join(row) for row in [["0", "1", "2"]] * 3 + table) + "\n"
    path = written(folder, text)
    logging.disable(logging.WARNING)
    try:
        mixed = read_recording(path, ["a"])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rows.RowReader, "_by_arrow", lambda *_: None)
            slow = read_recording(path, ["a"])
    finally:
        logging.disable(logging.NOTSET)
    assert mixed.columns.keys() == slow.columns.keys()
    for name, column in mixed.columns.items():
        np.testing.assert_array_equal(column, slow.columns[name])
    np.testing.assert_array_equal(mixed.malformed, slow.malformed)
    np.testing.assert_array_equal(mixed.line, slow.line)
