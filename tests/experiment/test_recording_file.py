"""Tables of numbers with the decimals that their units ask for."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import RecordingError
from softfuse.experiment.recording_file import with_decimals, write_recording
from softfuse.hardware.recording import read_recording

STEPS = np.arange(5.0)
TRUTH = {"sample": np.array([0.0, 0, 1, 0, 0]), "true_force_N": 0.1234567 * STEPS}
COLUMNS = {"time_s": (3, 0.01 * STEPS), "flow0_V": (None, 0.5 + STEPS / 4096), **with_decimals(TRUTH)}


def test_a_recording_holds_its_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    write_recording(path, COLUMNS)
    found = read_recording(path, ["flow0_V", "sample", "true_force_N"])
    np.testing.assert_allclose(found.time_s, 0.01 * STEPS)
    np.testing.assert_allclose(found.columns["flow0_V"], 0.5 + STEPS / 4096, rtol=1e-7)
    np.testing.assert_array_equal(found.columns["sample"], [0, 0, 1, 0, 0])
    np.testing.assert_allclose(found.columns["true_force_N"], 0.1234567 * STEPS, atol=5e-6)
    with gzip.open(path, "rt") as stream:
        assert stream.readlines()[2] == "0.010,0.50024414,0,0.12346\n"


def test_unknown_numbers_are_empty_and_zeros_have_no_sign(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    write_recording(path, {"time_s": (3, STEPS[:2]), "true_x_mm": (2, np.array([np.nan, -0.001]))})
    assert path.read_text() == "time_s,true_x_mm\n0.000,\n1.000,0.00\n"


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot write the recording"):
        write_recording(tmp_path / "none" / "a.csv", COLUMNS)
