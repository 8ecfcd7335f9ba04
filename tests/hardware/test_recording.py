"""Reading recordings, damaged ones above all."""

import gzip

import numpy as np
import pytest

from softfuse.errors import RecordingError
from softfuse.hardware.recording import read_recording

HEADER = "time_s,flow0_V,row0,press"
GOOD = [HEADER, "0.00,0.5,20000,0", "0.01,0.6,20010,0", "0.02,0.7,20020,1"]


def written(tmp_path, lines, name="pad.csv", end="\n"):
    path = tmp_path / name
    path.write_bytes("\n".join(lines).encode() + end.encode())
    return path


def test_columns_come_back_as_recorded_with_truth(tmp_path):
    recording = read_recording(written(tmp_path, GOOD), ["flow0_V", "row0"])
    np.testing.assert_array_equal(recording.time_s, [0.0, 0.01, 0.02])
    np.testing.assert_array_equal(recording.matrix(["row0", "flow0_V"]).T[0], [20000, 20010, 20020])
    np.testing.assert_array_equal(recording.columns["press"], [0, 0, 1])
    assert recording.matrix([]).shape == (3, 0)
    assert not recording.malformed.any() and not recording.disordered.any() and recording.complete


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("0.01,0.6,200", [0.01, 0.6, np.nan, np.nan]),
        ("0.0", [np.nan] * 4),
        ("0.01,,20010,0", [0.01, np.nan, 20010, 0]),
        ("0.01,abc,20010,0", [0.01, np.nan, 20010, 0]),
        ("0.01,nan,20010,0", [0.01, np.nan, 20010, 0]),
        ("0.01,inf,20010,0", [0.01, np.nan, 20010, 0]),
        ("0.01,0.6,20010,0,99", [0.01, 0.6, 20010, 0]),
        ('0.01,"0.6,20010,0', [0.01, np.nan, 20010, 0]),
        ("\x00\x00,0.6,20010,0", [np.nan, 0.6, 20010, 0]),
    ],
)
def test_a_malformed_row_keeps_its_place_and_is_flagged(tmp_path, line, expected):
    lines = [*GOOD[:2], line, GOOD[3]]
    recording = read_recording(written(tmp_path, lines), ["flow0_V", "row0"])
    values = recording.matrix(["time_s", "flow0_V", "row0", "press"])
    assert values.shape == (3, 4)
    np.testing.assert_array_equal(values[1], expected)
    np.testing.assert_array_equal(recording.malformed, [False, True, False])
    np.testing.assert_array_equal(recording.line, [2, 3, 4])
    np.testing.assert_array_equal(values[2], [0.02, 0.7, 20020, 1])


def test_a_file_cut_within_its_last_line_loses_that_field_only(tmp_path):
    path = written(tmp_path, [*GOOD[:3], "0.02,0.7,2"], end="")
    recording = read_recording(path, ["flow0_V", "row0"])
    assert recording.malformed.tolist() == [False, False, True]
    assert np.isnan(recording.columns["row0"][2]) and recording.columns["flow0_V"][2] == 0.7


def test_blank_lines_and_windows_ends_are_no_rows(tmp_path):
    path = tmp_path / "pad.csv"
    path.write_bytes("\ufeff".encode() + "\r\n".join([*GOOD[:2], "", GOOD[2], ""]).encode())
    recording = read_recording(path, ["row0"])
    assert recording.line.tolist() == [2, 4] and not recording.malformed.any()


def test_time_that_does_not_increase_is_flagged(tmp_path):
    times = ["0.00", "0.01", "0.01", "0.005", "", "0.02"]
    lines = [HEADER, *(f"{t},0.5,20000,0" for t in times)]
    recording = read_recording(written(tmp_path, lines), ["row0"])
    assert recording.disordered.tolist() == [False, False, True, True, True, False]


def test_a_missing_first_time_does_not_disorder_the_rest(tmp_path):
    lines = [HEADER, ",0.5,20000,0", *GOOD[1:]]
    recording = read_recording(written(tmp_path, lines), ["row0"])
    assert recording.disordered.tolist() == [True, False, False, False]


def test_a_header_without_rows_is_an_empty_recording(tmp_path):
    recording = read_recording(written(tmp_path, [HEADER]), ["row0"])
    assert recording.time_s.shape == (0,) and recording.matrix(["row0"]).shape == (0, 1)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([""], ["empty"]),
        (["time_s,row0", "0,1"], ["'flow0_V'", "lacks the column"]),
        (["row0,flow0_V", "1,2"], ["'time_s'"]),
        (["time_s,flow0_V,flow0_V", "0,1,2"], ["'flow0_V' twice"]),
        (["0.0,0.5,20000,0"], ["must name the columns"]),
    ],
)
def test_an_unusable_file_is_refused_by_name(tmp_path, lines, words):
    path = written(tmp_path, lines)
    with pytest.raises(RecordingError) as error:
        read_recording(path, ["flow0_V"])
    for word in [*words, "pad.csv"]:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path / "absent.csv", tmp_path):
        with pytest.raises(RecordingError, match="cannot open"):
            read_recording(path, [])


def test_a_field_without_end_is_refused(tmp_path):
    path = written(tmp_path, [HEADER, "0.00,0.5," + "1" * 200_000])
    with pytest.raises(RecordingError, match="no table of numbers"):
        read_recording(path, [])


def test_compressed_recordings_whole_cut_and_false(tmp_path):
    rng = np.random.default_rng(0)
    lines = [HEADER, *(f"{0.01 * i:.2f},{rng.random():.6f},{rng.integers(1000000)},0" for i in range(4000))]
    data = gzip.compress(("\n".join(lines) + "\n").encode())
    path = tmp_path / "pad.csv.gz"
    path.write_bytes(data)
    assert read_recording(path, ["row0"]).time_s.size == 4000
    path.write_bytes(data[: len(data) // 2])
    cut = read_recording(path, ["row0"])
    assert not cut.complete and 500 < cut.time_s.size < 4000
    path.write_bytes(data[:5000] + b"no deflate" * 9 + data[5090:])
    assert not read_recording(path, ["row0"]).complete
    path.write_bytes(b"no gzip at all")
    with pytest.raises(RecordingError, match="not a gzip file"):
        read_recording(path, ["row0"])


def test_some_rows_are_a_recording_too(tmp_path):
    whole = read_recording(written(tmp_path, [*GOOD[:3], "0.0x,0.7,20020,1"]), ["flow0_V"])
    part = whole.rows(np.array([0, 2]))
    np.testing.assert_array_equal(part.columns["flow0_V"], [0.5, 0.7])
    np.testing.assert_array_equal(part.line, whole.line[[0, 2]])
    assert part.malformed.tolist() == [False, True] and part.path == whole.path
