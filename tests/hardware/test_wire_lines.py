"""Lines of text from hobby boards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softfuse.errors import WireError
from softfuse.hardware.wire.channel import Channel, RawType
from softfuse.hardware.wire.decoder import Received
from softfuse.hardware.wire.description import Description
from softfuse.hardware.wire.layout import Layout
from softfuse.hardware.wire.lines import LineDecoder, LineFormat
from softfuse.hardware.wire.message import DescriptionMessage, SampleMessage, TextMessage

MAP = {"b": "flow0_V", "a": "row0"}
ROWS = LineFormat(MAP, columns=("time_us", "a", "b"))
HEADED = LineFormat(MAP)


def samples(received: list[Received]) -> list[tuple[int, int, list[float]]]:
    """Sequence, time and values of the samples."""
    return [
        (one.message.header.sequence, one.message.header.time_us, one.values.tolist())
        for one in received
        if isinstance(one.message, SampleMessage) and one.values is not None
    ]


def read(form: LineFormat, text: str, *, host_s: float = 0.0) -> tuple[LineDecoder, list[Received]]:
    """What comes of a stream that was opened at the end of a line."""
    decoder = LineDecoder(form, device=4)
    return decoder, decoder.feed(b"\n" + text.encode(), host_s)


@pytest.mark.parametrize("header", ["time_us,a,b,c", "#time_us,a,b,c", "# time_us, a ,b,c", "#a,b,c"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_header_names_the_columns(header, end):
    decoder, received = read(HEADED, end.join([header, "10,1,0.25,9", "20,2,-5e-1,9", ""]))
    assert samples(received) == [(0, 10, [0.25, 1.0]), (1, 20, [-0.5, 2.0])]
    channels = tuple(Channel(name, RawType.F64, 1.0, 0.0) for name in ("flow0_V", "row0"))
    assert received[0].message.description == Description("lines", channels)
    assert {one.message.header.device for one in received} == {4}
    assert (decoder.counts.headers, decoder.counts.samples) == (1, 2)


def test_the_content_says_what_the_values_say():
    _, received = read(ROWS, "1,0.1,1e-300\n")
    description, sample = (one.message for one in received)
    assert isinstance(description, DescriptionMessage) and isinstance(sample, SampleMessage)
    layout = Layout(description.description)
    assert sample.layout == layout.number
    np.testing.assert_array_equal(layout.values(sample.content), received[1].values)


def test_without_a_header_the_given_columns_hold_and_one_description_comes_first():
    _, received = read(ROWS, "1,2,3\n2,3,4\n")
    assert [type(one.message) for one in received] == [DescriptionMessage, SampleMessage, SampleMessage]


def test_without_columns_nothing_is_guessed():
    decoder, received = read(HEADED, "1,2,3\n2,3,4\n")
    assert received == [] and decoder.counts.undescribed == 2


@pytest.mark.parametrize(
    "line",
    ["1,2", "1,2,3,4", "1,2,3,,", "nan,2,3", "x,2,3", ",2,3", "-1,2,3", "1e17,2,3", "µ,2,3", "1;2;3", "1 2 3",
     "nan,nan,nan", "x,y,z"],
)  # fmt: skip
def test_a_malformed_line_is_counted_and_leaves_a_gap(line):
    decoder, received = read(ROWS, f"1,2,3\n{line}\n2,3,4\n")
    assert samples(received) == [(0, 1, [3.0, 2.0]), (2, 2, [4.0, 3.0])]
    assert decoder.counts.malformed == 1


@pytest.mark.parametrize("field", ["nan", "inf", "1e999", "", "x", "1_0", "3µ", "\0003", "ERROR", "0x1"])
def test_a_bad_field_costs_its_channel_only(field):
    decoder, received = read(ROWS, f"1,2,3\n2,7,{field}\n3,{field},8\n4,5,6\n")
    found = samples(received)
    assert [(sequence, time) for sequence, time, _ in found] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    np.testing.assert_array_equal([v for *_, v in found], [[3, 2], [np.nan, 7], [8, np.nan], [6, 5]])
    assert (decoder.missing, decoder.counts.malformed, decoder.counts.samples) == (2, 0, 4)
    description, *sent = (one.message for one in received)
    assert isinstance(description, DescriptionMessage) and isinstance(sent[1], SampleMessage)
    content = Layout(description.description).values(sent[1].content)
    np.testing.assert_array_equal(content, [np.nan, 7])


@pytest.mark.parametrize("field", ["OK", "", "nan", "°C", "1,"])
def test_what_is_in_unwanted_columns_does_not_matter(field):
    form = LineFormat(MAP, columns=("time_us", "a", "b", "state"))
    decoder, received = read(form, f"1,2,3,{field}\n")
    assert samples(received) == [(0, 1, [3.0, 2.0])] and decoder.missing == 0
    headed = read(HEADED, f"time_us,a,b,state,state\n1,2,3,{field.strip(',')},{field}\n")[1]
    assert samples(headed) == [(0, 1, [3.0, 2.0])]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_an_empty_field_after_the_last_separator_is_none(separator):
    text = "time_us,a,b,\n1,2,3,\n2,3,,\n3,4,5\n".replace(",", separator)
    decoder, received = read(LineFormat(MAP, separator=separator), text)
    np.testing.assert_array_equal([v for *_, v in samples(received)], [[3, 2], [np.nan, 3], [5, 4]])
    assert (decoder.counts.headers, decoder.counts.malformed, decoder.missing) == (1, 0, 1)
    told = LineFormat(MAP, columns=("time_us", "a", "b"), separator=separator)
    assert len(samples(read(told, text)[1])) == 3


def test_remarks_are_handed_on():
    decoder, received = read(ROWS, "# MPR121 found\nMPR121 not found, check wiring?\n\n1,2,3\n")
    texts = [one.message.text for one in received if isinstance(one.message, TextMessage)]
    assert texts == ["# MPR121 found", "MPR121 not found, check wiring?"]
    assert decoder.counts.remarks == 2 and samples(received) == [(0, 1, [3.0, 2.0])]


def test_the_first_line_of_a_stream_is_not_believed_unless_it_is_a_header():
    decoder = LineDecoder(ROWS)
    assert samples(decoder.feed(b"45,2,3\n46,2,3\n", 0.0)) == [(0, 46, [3.0, 2.0])]
    decoder.feed(b"47,", 0.0)
    decoder.discard_partial()
    assert samples(decoder.feed(b"8,2,3\n49,2,3\n", 0.0)) == [(1, 49, [3.0, 2.0])]
    assert decoder.counts.partial == 2 and decoder.counts.bytes_discarded == 3
    assert samples(LineDecoder(HEADED).feed(b"time_us,a,b\n46,2,3\n", 0.0)) == [(0, 46, [3.0, 2.0])]


@pytest.mark.parametrize(
    ("time", "field", "time_us"), [("t_us", "7", 7), ("t_ms", "7", 7000), ("t_s", "1.0000015", 1000002)]
)
def test_units_of_time(time, field, time_us):
    form = LineFormat({"a": "row0"}, columns=(time, "a"), time=time)
    assert samples(read(form, f"{field},1\n")[1]) == [(0, time_us, [1.0])]


def test_without_a_time_column_the_time_of_arrival_is_taken():
    form = LineFormat({"a": "row0"}, columns=("a", "b"), time=None)
    assert samples(read(form, "1,2\n", host_s=2.5)[1]) == [(0, 2_500_000, [1.0])]


@pytest.mark.parametrize(("unit", "factor"), [("us", 1), ("ms", 1000)])
def test_a_counter_of_32_bits_is_carried_on_and_a_restart_is_not(unit, factor):
    form = LineFormat({"a": "row0"}, columns=(f"time_{unit}", "a"), time=f"time_{unit}")
    raw = [2**32 - 10, 5, 20, 2**32 - 5, 1, 2**31, 7]
    _, received = read(form, "".join(f"{time},1\n" for time in raw))
    expected = [raw[0], 2**32 + 5, 2**32 + 20, 2**33 - 5, 2**33 + 1, 2**33 + 2**31, 7]
    assert [time for _, time, _ in samples(received)] == [factor * time for time in expected]


@pytest.mark.parametrize(("separator", "text"), [(";", "1; 2;3"), ("\t", "1\t2\t3"), (" ", " 1  2 3 ")])
def test_separators(separator, text):
    form = LineFormat(MAP, columns=("time_us", "a", "b"), separator=separator)
    assert samples(read(form, text + "\n")[1]) == [(0, 1, [3.0, 2.0])]


def test_a_line_without_end_takes_no_memory():
    decoder, _ = read(ROWS, "1,2,3\n")
    for _ in range(1000):
        assert decoder.feed(b"1" * 1000, 0.0) == []
        assert len(decoder._partial) <= 16384
    assert samples(decoder.feed(b"\n2,3,4\n", 0.0)) == [(2, 2, [4.0, 3.0])]
    assert decoder.counts.oversized == 1 and decoder.counts.bytes_discarded == 1_000_000


LINES = st.one_of(
    st.sampled_from(["time_us,a,b", "#a,b", "# hello", "", "1,2", "1,2,x"]),
    st.tuples(st.integers(0, 2**33), st.floats(), st.integers(-9, 9)).map(
        lambda row: ",".join(map(str, row))
    ),
).map(str.encode)


@given(data=st.data(), lines=st.lists(st.one_of(LINES, st.binary(max_size=20)), max_size=10))
def test_any_bytes_are_accounted_for_and_pieces_do_not_matter(data, lines, pieces_of):
    stream = b"\n".join(lines)
    whole, cut = LineDecoder(HEADED), LineDecoder(HEADED)
    received = whole.feed(stream, 0.0)
    again = [one for piece in data.draw(pieces_of(stream)) for one in cut.feed(piece, 0.0)]
    assert [one.message for one in again] == [one.message for one in received]
    assert whole.counts == cut.counts
    counts = vars(whole.counts)
    some = [line for line in stream.split(b"\n")[:-1] if line.strip()]
    assert sum(counts.values()) - counts["bytes_discarded"] == len(some)


@given(
    rows=st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=1, max_size=10)
)
def test_any_finite_values_come_back_exactly(rows):
    _, received = read(ROWS, "".join(f"{k},{a!r},{b!r}\n" for k, (a, b) in enumerate(rows)))
    assert samples(received) == [(k, k, [b, a]) for k, (a, b) in enumerate(rows)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"time": "when"}, "'when' has no unit"),
        ({"separator": "1"}, "separated by '1'"),
        ({"columns": ("time_us", "a")}, "lack 'b'"),
        ({"columns": ("time_us", "a", "a", "b")}, "one twice"),
        ({"columns": ("time_us", "a", "b", "7")}, "number '7'"),
    ],
)
def test_formats_that_cannot_be_are_refused(options, words):
    with pytest.raises(WireError, match=words):
        LineFormat(MAP, **options)
