"""Where to press, and what a recording holds of it; and the recording itself."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import FrameEntry
from softfuse.hardware.recording import read_recording
from softfuse.hardware.testbed.files import CsvRecording
from softfuse.hardware.testbed.places import LABELS, grid, next_press, pressed, read_places, remaining


def columns(*rows: tuple[float, ...]) -> dict[str, np.ndarray]:
    return dict(zip(LABELS, np.array(rows, float).reshape(-1, 5).T, strict=True))


def test_a_grid_covers_the_workspace_there_and_back():
    places = grid((-0.02, 0.02), (-0.01, 0.01), (3, 2))
    assert places == [(-0.02, -0.01), (0.0, -0.01), (0.02, -0.01), (0.02, 0.01), (0.0, 0.01), (-0.02, 0.01)]
    assert grid((-0.02, 0.02), (0.0, 0.01), (1, 1)) == [(0.0, 0.005)]


def test_only_presses_with_all_levels_are_done():
    table = columns(
        (0, 0, 5, 6, 1), (0, 1, 5, 6, 5), (0, 2, 5, 6, 10), (1, 1, 7, 8, 5), (4, 1, 9, 9, 5), (4, 2, 9, 9, 9)
    )
    done = pressed(table, 2)
    np.testing.assert_allclose(done, [(5e-3, 6e-3), (9e-3, 9e-3)], rtol=1e-12)
    assert next_press(table) == 5
    assert pressed(table, 3) == []
    places = [(5.01e-3, 6e-3), (7e-3, 8e-3), (9e-3, 9.1e-3)]
    assert remaining(places, done) == places[1:]
    assert next_press(columns()) == 0 and pressed({}, 1) == []


def test_a_sample_without_a_place_is_none():
    assert pressed(columns((0, 1, math.nan, 0, 5)), 1) == []


def test_places_are_read_and_mistakes_are_told(tmp_path: Path):
    path = tmp_path / "p.csv"
    path.write_text("y_mm,x_mm,remark\n1,2,a\n-3.5,4,b\n")
    assert read_places(path) == [(2e-3, 1e-3), (4e-3, -3.5e-3)]
    path.write_text("x_mm;y_mm;\n2;1;\n4;-3,5;\n", encoding="utf-16")
    assert read_places(path) == [(2e-3, 1e-3), (4e-3, -3.5e-3)]
    for text, told in (
        ("x_mm,y_mm\n1,2\n1,x\n", "line 3"),
        ("x,y\n1,2\n", "line 2"),
        ("x_mm,y_mm\n", "no pl"),
    ):
        path.write_text(text)
        with pytest.raises(RecordingError, match=told):
            read_places(path)
    with pytest.raises(RecordingError, match="cannot read the places"):
        read_places(tmp_path / "none.csv")


def entry(k: int) -> FrameEntry:
    return FrameEntry(k, 1.7e9 + 0.01 * k, np.array([k + 0.1, math.nan]))


def test_a_recording_is_continued_also_after_a_cut_row(tmp_path: Path):
    path = tmp_path / "r.csv"
    first = CsvRecording(path, ("a_V", "b_V"))
    for k in range(5):
        first.frame(entry(k))
    first.close()
    os.truncate(path, path.stat().st_size - 4)
    second = CsvRecording(path, ("a_V", "b_V"))
    second.frame(entry(5))
    second.close()
    recording = read_recording(path, ["a_V"])
    assert recording.time_s[[0, 3, 5]].tolist() == [entry(k).time_s for k in (0, 3, 5)]
    assert recording.columns["a_V"][[0, 3, 5]].tolist() == [0.1, 3.1, 5.1]
    assert recording.malformed[4] and len(recording.time_s) == 6


def test_a_recording_of_other_columns_is_left_alone(tmp_path: Path):
    path = tmp_path / "r.csv"
    path.write_text("time_s,a_V\n1,2\n")
    with pytest.raises(RecordingError, match="has other columns"):
        CsvRecording(path, ("a_V", "b_V"))
    assert path.read_text() == "time_s,a_V\n1,2\n"
    with pytest.raises(RecordingError, match="cannot write"):
        CsvRecording(tmp_path / "none" / "r.csv", ("a_V",))
