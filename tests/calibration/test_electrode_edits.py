"""Gains and baselines of crossed electrodes: from settings to sensors, and from a fit to settings."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.calibration.electrode_edits import Untouched, baseline_edits, gain_edits, untouched, with_gains
from softfuse.calibration.electrode_gains import GainFit
from softfuse.errors import ConfigError
from softfuse.robot.file import load, save_edited
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.capacitive import CapacitiveArray
from softfuse.sensors.crossed.settings import CrossedSettings

Write = Callable[..., Path]

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"

PLACE = "noise_counts = 8.0\n"
GIVEN = "row_gain = [1.0, 1.1, 0.9, 1.0, 1.0, 1.0, 1.0, 1.2]\ncolumn_gain = 0.5\n"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes configs/pad.toml with pieces of its text replaced: write((old, new), ...)."""

    def written(*changes: tuple[str, str]) -> Path:
        text = PAD.read_text(encoding="utf-8")
        for old, new in changes:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def lines_of(settings: RobotSettings) -> CapacitiveArray:
    """The electronics of its crossed lines."""
    return settings.sensors_of(CrossedSettings)[0].array()


def test_what_was_fitted_is_read_again(write: Write, tmp_path: Path) -> None:
    source = write((PLACE, PLACE + GIVEN))
    config = load(source)
    before = np.asarray(lines_of(config).gain)
    np.testing.assert_allclose(before[[1, 2, 7, 8, 15]], [1.1, 0.9, 1.2, 0.5, 0.5])
    assert np.isinf(lines_of(config).untouched_counts).all()
    value = np.random.default_rng(0).normal(0.0, 0.05, 16)
    gains = GainFit(("gain",) * 16, value, 1e-4 * np.eye(16), np.full(16, 0.05), 8)
    counts = 20000.0 + 10.0 * np.arange(16)
    told = with_gains(config, gains)
    edits = {**gain_edits(told), **baseline_edits(config, Untouched(counts, np.ones(16)))}
    after = save_edited(source, tmp_path / "fitted.toml", edits)
    made = lines_of(load(tmp_path / "fitted.toml"))
    np.testing.assert_allclose(made.gain, before * np.exp(value), rtol=1e-5)
    np.testing.assert_array_equal(made.gain, lines_of(told).gain)
    np.testing.assert_array_equal(made.untouched_counts, counts)
    assert after.sensors_of(CrossedSettings)[0].row_baseline == tuple(counts[:8])


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (
            "row_gain = [1.0, 1.0]",
            "sensor[1].row_gain: 2 values for 8 channels: give one, or one for each",
        ),
        ("column_gain = [1.0, 0.9, 1.1]", "sensor[1].column_gain: 3 values for 8 channels"),
        ("column_gain = 0.0", "sensor[1].column_gain"),
        ("row_baseline = [1.0]\ncolumn_baseline = [1.0]", "sensor[1].row_baseline: 1 values for 8"),
        (f"row_baseline = {[1.0] * 8}", "sensor[1].column_baseline: missing, while row_baseline"),
        (f"column_baseline = {[1.0] * 8}", "sensor[1].row_baseline: missing, while column_baseline"),
    ],
)
def test_a_wrong_number_is_told(write: Write, said: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(write((PLACE, f"{PLACE}{said}\n")))
    assert told in str(caught.value)


def test_the_baseline_is_what_was_read_while_nothing_was_near() -> None:
    rng = np.random.default_rng(1)
    counts = 20000.0 + 8.0 * rng.standard_normal((300, 4))
    counts[100:] += 3000.0
    near = np.arange(300) >= 100
    found = untouched(counts, np.broadcast_to(~near[:, None], counts.shape))
    assert found is not None
    np.testing.assert_allclose(found.counts, 20000.0, atol=4.0)
    np.testing.assert_allclose(found.sigma, 8.0, rtol=0.3)
    few = np.broadcast_to(np.arange(300)[:, None] < 20, counts.shape)
    assert untouched(counts, few) is None
