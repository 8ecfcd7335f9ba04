"""The driver of boards that print lines, on lines of the form that the sketches' sources have."""

import numpy as np
import pytest

from softfuse.errors import WireError
from softfuse.hardware.source.text_lines import PRESETS, TextFormat, TextLines

NAN = float("nan")
BARE_CONDUCTIVE = (
    "TOUCH: 0 0 0 0 0 0 0 0 0 0 0 0 0\r\nTTHS: 40 40 40 40 40 40 40 40 40 40 40 40 40\r\n"
    "RTHS: 20 20 20 20 20 20 20 20 20 20 20 20 20\r\n"
    "FDAT: 701 702 703 704 705 706 707 708 709 710 711 712 713\r\n"
    "BVAL: 700 700 700 700 700 700 700 700 700 700 700 700 700\r\n"
    "DIFF: -1 -2 -3 -4 -5 -6 -7 -8 -9 -10 -11 -12 -13\r\n"
)
ADAFRUIT = (
    "the sensor is there\r\nelectrode 0: touch\r\n"
    "\t\t\t\t\t\t\t\t\t\t\t\t\t 0x1\r\nFilt: 1\t2\t3\t4\t5\t6\t7\t8\t9\t10\t11\t12\t\r\n"
    "Base: 9\t9\t9\t9\t9\t9\t9\t9\t9\t9\t9\t9\t\r\n"
)
FDC_SINGLE = (
    "✓ the sensor is there\r\n\r\nnow measuring pad 0\r\n"
    "t(ms)\tC(pF)\toffset\thow\r\n=====\r\n"
    "1250\t\t3.1415\t\t4\tgood\r\n1500\t\tERROR\t\t-\tnothing measured\r\n"
    "1750\t\t-2.7183\t\t5\toffset moved\r\n"
)
FDC_MULTI = (
    "t(s)\ta(pF)\tb(pF)\tc(pF)\td(pF)\thow\r\n"
    "0.5\t1.25\t2.50\t-3.75\t5.00\t[....]\r\n1.0\t1.26\tERROR\t-3.75\t5.00\t[.x..]\r\n"
    "1.5\t1.27\t2.51\t-3.75\t5.00\t[..m.] offset: c=7\r\n"
)
TRILL = "no sensor is there\r\n" + "".join(f"{k:04d} " for k in range(30)) + "\r\n"
MUCA = ",".join(str(4000 + k) for k in range(252)) + "\r\n"


@pytest.mark.parametrize(
    ("preset", "printed", "channels", "expected"),
    [
        ("mpr121-bare-conductive", BARE_CONDUCTIVE, {"e0": "row0", "e12": "near"}, [[701.0, 713.0]]),
        ("mpr121-adafruit", ADAFRUIT, {"e11": "row1", "e0": "row0"}, [[12.0, 1.0]]),
        ("fdc1004-single", FDC_SINGLE, {"pF": "module0_pF"}, [[3.1415], [NAN], [-2.7183]]),
        ("fdc1004-multi", FDC_MULTI, {"pF1": "b", "pF0": "a"}, [[2.5, 1.25], [NAN, 1.26], [2.51, 1.27]]),
        ("trill-craft", TRILL, {"c29": "col7", "c0": "col0"}, [[29.0, 0.0]]),
        ("muca", MUCA, {"c0": "first", "c251": "last"}, [[4000.0, 4251.0]]),
    ],
)
@pytest.mark.parametrize("step", [1, 7, 10_000])
def test_what_the_sketches_print_is_read(preset, printed, channels, expected, step):
    driver = TextLines(PRESETS[preset], channels)
    # The first line after opening may be half of one.
    stream = b"13 7\r\n" + printed.encode()
    readings = [
        reading
        for k in range(0, len(stream), step)
        for reading in driver.feed(stream[k : k + step], host_s=float(k))
    ]
    np.testing.assert_array_equal([reading.values for reading in readings], expected)
    assert {reading.names for reading in readings} == {tuple(channels.values())}
    assert driver.counts["samples"] == len(expected)
    assert driver.counts["malformed"] == 0
    assert driver.counts["missing readings"] == ("ERROR" in printed)


def test_the_time_is_the_boards_only_where_it_prints_a_fine_one():
    single = TextLines(PRESETS["fdc1004-single"], {"pF": "a_pF"})
    times = [r.device_time_us for r in single.feed(b"x\n" + FDC_SINGLE.encode(), 9.0)]
    assert times == [1_250_000, 1_500_000, 1_750_000]
    multi = TextLines(PRESETS["fdc1004-multi"], {"pF0": "a_pF"})
    readings = multi.feed(b"x\n" + FDC_MULTI.encode(), 9.0)
    assert [(r.device_time_us, r.host_s) for r in readings] == [(None, 9.0)] * 3


def test_a_board_with_a_header_needs_no_columns():
    driver = TextLines(TextFormat(time="time_us"), {"b": "flow0_V"})
    (reading,) = driver.feed(b"time_us,a,b\n10,1,0.25\n", 3.0)
    assert (reading.device_time_us, reading.values.tolist()) == (10, [0.25])
    assert driver.counts["headers"] == 1


def test_remarks_are_told():
    driver = TextLines(TextFormat(("a", "b")), {"a": "x", "b": "y"})
    driver.feed(b"\nnow calibrating\n1,2\n", 3.0)
    assert [(n.level, n.text) for n in driver.take_notices()] == [("info", "now calibrating")]


@pytest.mark.parametrize("preset", ["mpr121-adafruit", "fdc1004-multi", "trill-craft"])
def test_half_a_line_is_not_believed_after_an_interruption(preset):
    printed = {"mpr121-adafruit": ADAFRUIT, "fdc1004-multi": FDC_MULTI, "trill-craft": TRILL}[preset].encode()
    column = PRESETS[preset].columns[-1]
    whole = TextLines(PRESETS[preset], {column: "last"})
    full = [r.values.tolist() for r in whole.feed(b"\n" + printed, 0.0)]
    for at in range(len(printed)):
        driver = TextLines(PRESETS[preset], {column: "last"})
        before = driver.feed(b"\n" + printed[:at], 0.0)
        driver.interrupted()
        after = driver.feed(printed[at + 3 :] + b"\n" + printed, 0.0)
        values = [r.values.tolist() for r in before + after]
        assert values[-len(full) :] == full
        assert all(value in full for value in values)


def test_lines_without_end_do_not_pile_up():
    driver = TextLines(PRESETS["mpr121-adafruit"], {"e0": "a"})
    for _ in range(200):
        driver.feed(b"x" * 10_000, 0.0)
    assert len(driver._partial) < 100_000
    assert driver.feed(b"\n" + ADAFRUIT.encode(), 0.0) != []


def test_columns_that_cannot_be_are_told():
    with pytest.raises(WireError, match="lack 'e12'"):
        TextLines(PRESETS["mpr121-adafruit"], {"e12": "near"})
    with pytest.raises(WireError, match="'a,b'"):
        TextLines(TextFormat(("a",)), {"a": "a,b"})


def test_any_bytes_are_taken():
    rng = np.random.default_rng(1)
    driver = TextLines(PRESETS["fdc1004-single"], {"pF": "a_pF"})
    for _ in range(300):
        driver.feed(rng.integers(0, 256, 200, dtype=np.uint8).tobytes(), 0.0)
    assert driver.counts["samples"] == 0
