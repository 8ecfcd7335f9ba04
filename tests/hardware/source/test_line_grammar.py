"""Lines of text from hobby boards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softfuse.errors import WireError
from softfuse.hardware.source.driver import Reading
from softfuse.hardware.source.text_lines import TextFormat, TextLines

MAP = {"b": "flow0_V", "a": "row0"}
ROWS = TextFormat(("time_us", "a", "b"), "time_us")
HEADED = TextFormat(time="time_us")


def samples(readings: list[Reading]) -> list[tuple[int, int, list[float]]]:
    """Sequence, time and values of the samples."""
    return [(one.sequence, one.device_time_us, one.values.tolist()) for one in readings]


def read(form: TextFormat, text: str, channels=MAP, *, host_s: float = 0.0):
    """The driver, and what comes of a stream that was opened at the end of a line."""
    driver = TextLines(form, channels)
    return driver, driver.feed(b"\n" + text.encode(), host_s)


@pytest.mark.parametrize("header", ["time_us,a,b,c", "#time_us,a,b,c", "# time_us, a ,b,c", "#a,b,c"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_header_names_the_columns(header, end):
    driver, readings = read(HEADED, end.join([header, "10,1,0.25,9", "20,2,-5e-1,9", ""]))
    assert samples(readings) == [(0, 10, [0.25, 1.0]), (1, 20, [-0.5, 2.0])]
    assert {one.names for one in readings} == {("flow0_V", "row0")}
    assert (driver.counts["headers"], driver.counts["samples"]) == (1, 2)


def test_without_columns_nothing_is_guessed():
    driver, readings = read(HEADED, "1,2,3\n2,3,4\n")
    assert readings == [] and driver.counts["before any header"] == 2


@pytest.mark.parametrize(
    "line",
    ["1,2", "1,2,3,4", "1,2,3,,", "nan,2,3", "x,2,3", ",2,3", "-1,2,3", "1e17,2,3", "µ,2,3", "1;2;3", "1 2 3",
     "nan,nan,nan", "x,y,z"],
)  # fmt: skip
def test_a_malformed_line_is_counted_and_leaves_a_gap(line):
    driver, readings = read(ROWS, f"1,2,3\n{line}\n2,3,4\n")
    assert samples(readings) == [(0, 1, [3.0, 2.0]), (2, 2, [4.0, 3.0])]
    assert driver.counts["malformed"] == 1


@pytest.mark.parametrize("field", ["nan", "inf", "1e999", "", "x", "1_0", "3µ", "\0003", "ERROR", "0x1"])
def test_a_bad_field_costs_its_channel_only(field):
    driver, readings = read(ROWS, f"1,2,3\n2,7,{field}\n3,{field},8\n4,5,6\n")
    found = samples(readings)
    assert [(sequence, time) for sequence, time, _ in found] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    np.testing.assert_array_equal([v for *_, v in found], [[3, 2], [np.nan, 7], [8, np.nan], [6, 5]])
    counts = driver.counts
    assert (counts["missing readings"], counts["malformed"], counts["samples"]) == (2, 0, 4)


@pytest.mark.parametrize("field", ["OK", "", "nan", "°C", "1,"])
def test_what_is_in_unwanted_columns_does_not_matter(field):
    form = TextFormat(("time_us", "a", "b", "state"), "time_us")
    driver, readings = read(form, f"1,2,3,{field}\n")
    assert samples(readings) == [(0, 1, [3.0, 2.0])] and driver.counts["missing readings"] == 0
    headed = read(HEADED, f"time_us,a,b,state,state\n1,2,3,{field.strip(',')},{field}\n")[1]
    assert samples(headed) == [(0, 1, [3.0, 2.0])]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_an_empty_field_after_the_last_separator_is_none(separator):
    text = "time_us,a,b,\n1,2,3,\n2,3,,\n3,4,5\n".replace(",", separator)
    driver, readings = read(TextFormat(time="time_us", separator=separator), text)
    np.testing.assert_array_equal([v for *_, v in samples(readings)], [[3, 2], [np.nan, 3], [5, 4]])
    counts = driver.counts
    assert (counts["headers"], counts["malformed"], counts["missing readings"]) == (1, 0, 1)
    told = TextFormat(("time_us", "a", "b"), "time_us", separator)
    assert len(samples(read(told, text)[1])) == 3


def test_remarks_are_handed_on():
    driver, readings = read(ROWS, "# MPR121 found\nMPR121 not found, check wiring?\n\n1,2,3\n")
    texts = [notice.text for notice in driver.take_notices()]
    assert texts == ["# MPR121 found", "MPR121 not found, check wiring?"]
    assert driver.counts["remarks"] == 2 and samples(readings) == [(0, 1, [3.0, 2.0])]


def test_the_first_line_of_a_stream_is_not_believed_unless_it_is_a_header():
    driver = TextLines(ROWS, MAP)
    assert samples(driver.feed(b"45,2,3\n46,2,3\n", 0.0)) == [(0, 46, [3.0, 2.0])]
    driver.feed(b"47,", 0.0)
    driver.interrupted()
    assert samples(driver.feed(b"8,2,3\n49,2,3\n", 0.0)) == [(1, 49, [3.0, 2.0])]
    assert driver.counts["without their beginning"] == 2 and driver.counts["bytes discarded"] == 3
    assert samples(TextLines(HEADED, MAP).feed(b"time_us,a,b\n46,2,3\n", 0.0)) == [(0, 46, [3.0, 2.0])]


@pytest.mark.parametrize(
    ("time", "field", "time_us"), [("t_us", "7", 7), ("t_ms", "7", 7000), ("t_s", "1.0000015", 1000002)]
)
def test_units_of_time(time, field, time_us):
    form = TextFormat((time, "a"), time)
    assert samples(read(form, f"{field},1\n", {"a": "row0"})[1]) == [(0, time_us, [1.0])]


def test_without_a_time_column_the_time_of_arrival_is_taken():
    (reading,) = read(TextFormat(("a", "b")), "1,2\n", {"a": "row0"}, host_s=2.5)[1]
    assert (reading.sequence, reading.device_time_us, reading.host_s) == (0, None, 2.5)
    assert reading.values.tolist() == [1.0]


@pytest.mark.parametrize(("unit", "factor"), [("us", 1), ("ms", 1000)])
def test_a_counter_of_32_bits_is_carried_on_and_a_restart_is_not(unit, factor):
    form = TextFormat((f"time_{unit}", "a"), f"time_{unit}")
    raw = [2**32 - 10, 5, 20, 2**32 - 5, 1, 2**31, 7]
    _, readings = read(form, "".join(f"{time},1\n" for time in raw), {"a": "row0"})
    expected = [raw[0], 2**32 + 5, 2**32 + 20, 2**33 - 5, 2**33 + 1, 2**33 + 2**31, 7]
    assert [time for _, time, _ in samples(readings)] == [factor * time for time in expected]


@pytest.mark.parametrize(("separator", "text"), [(";", "1; 2;3"), ("\t", "1\t2\t3"), (" ", " 1  2 3 ")])
def test_separators(separator, text):
    form = TextFormat(("time_us", "a", "b"), "time_us", separator)
    assert samples(read(form, text + "\n")[1]) == [(0, 1, [3.0, 2.0])]


def test_a_line_without_end_takes_no_memory():
    driver, _ = read(ROWS, "1,2,3\n")
    for _ in range(1000):
        assert driver.feed(b"1" * 1000, 0.0) == []
        assert len(driver._partial) <= 16384
    assert samples(driver.feed(b"\n2,3,4\n", 0.0)) == [(2, 2, [4.0, 3.0])]
    assert driver.counts["too long"] == 1 and driver.counts["bytes discarded"] == 1_000_000


LINES = st.one_of(
    st.sampled_from(["time_us,a,b", "#a,b", "# hello", "", "1,2", "1,2,x"]),
    st.tuples(st.integers(0, 2**33), st.floats(), st.integers(-9, 9)).map(
        lambda row: ",".join(map(str, row))
    ),
).map(str.encode)


@given(data=st.data(), lines=st.lists(st.one_of(LINES, st.binary(max_size=20)), max_size=10))
def test_any_bytes_are_accounted_for_and_pieces_do_not_matter(data, lines, pieces_of):
    stream = b"\n".join(lines)
    whole, cut = TextLines(HEADED, MAP), TextLines(HEADED, MAP)
    readings = whole.feed(stream, 0.0)
    again = [one for piece in data.draw(pieces_of(stream)) for one in cut.feed(piece, 0.0)]
    np.testing.assert_equal(samples(again), samples(readings))
    assert whole.counts == cut.counts and whole.take_notices() == cut.take_notices()
    kinds = ("samples", "malformed", "too long", "before any header", "without their beginning", "headers")
    some = [line for line in stream.split(b"\n")[:-1] if line.strip()]
    assert sum(whole.counts[kind] for kind in (*kinds, "remarks")) == len(some)


@given(
    rows=st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=1, max_size=10)
)
def test_any_finite_values_come_back_exactly(rows):
    _, readings = read(ROWS, "".join(f"{k},{a!r},{b!r}\n" for k, (a, b) in enumerate(rows)))
    assert samples(readings) == [(k, k, [b, a]) for k, (a, b) in enumerate(rows)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"time": "when"}, "'when' has no unit"),
        ({"separator": "1"}, "separated by '1'"),
        ({"columns": ("time_us", "a"), "time": "time_us"}, "lack 'b'"),
        ({"columns": ("time_us", "a", "a", "b")}, "one twice"),
        ({"columns": ("time_us", "a", "b", "7")}, "number '7'"),
    ],
)
def test_formats_that_cannot_be_are_refused(options, words):
    with pytest.raises(WireError, match=words):
        TextLines(TextFormat(**options), MAP)
