"""Programmes recorded as their channels say them."""

from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import RecordingError
from softfuse.experiment.programme import Programme
from softfuse.experiment.recording_file import recorded, write_recording
from softfuse.hardware.recording import read_recording
from softfuse.sensors.electronics import equal_channels

STEPS = np.arange(5.0)
PROGRAMME = Programme(
    0.01,
    ("flow0_V", "row0"),
    np.stack([0.5 + 0.1 * STEPS, 20000 + 10 * STEPS], axis=1),
    {"sample": np.array([0, 0, 1, 0, 0]), "true_force_N": 0.123456 * STEPS},
    frozenset({"sample"}),
)
SILENT = equal_channels(2, noise=0.0, step=1e-6, low=0.0, high=1e5)


def test_a_recording_holds_channels_and_truth_with_their_decimals(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    write_recording(path, recorded(PROGRAMME, SILENT, (1, 2)))
    found = read_recording(path, ["flow0_V", "row0", "sample", "true_force_N"])
    np.testing.assert_allclose(found.time_s, 0.01 * STEPS)
    np.testing.assert_allclose(found.columns["flow0_V"], PROGRAMME.readings[:, 0], atol=1e-5)
    np.testing.assert_array_equal(found.columns["row0"], PROGRAMME.readings[:, 1])
    np.testing.assert_array_equal(found.columns["sample"], [0, 0, 1, 0, 0])
    np.testing.assert_allclose(found.columns["true_force_N"], 0.123456 * STEPS, atol=5e-6)


def test_the_seed_decides_about_the_noise() -> None:
    noisy = equal_channels(2, noise=1.0, step=1e-6, low=-1e5, high=1e5)
    one, same, other = (recorded(PROGRAMME, noisy, seed)["row0"][1] for seed in ((1, 1), (1, 1), (1, 2)))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.1


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot write the recording"):
        write_recording(tmp_path / "none" / "a.csv", recorded(PROGRAMME, SILENT, (1,)))
