"""The test beds of the evaluation: what is done, and that they are not the estimator's model."""

from pathlib import Path

import numpy as np
import pytest

from softfuse.robot.file import load
from softfuse.experiment.build_evaluation import build_bed
from softfuse.experiment.build_virtual_finger import FingerPlan
from softfuse.experiment.build_virtual_pad import PadPlan
from softfuse.errors import ConfigError
from softfuse.experiment.finger_bed import TABLE_III
from softfuse.experiment.virtual_finger import FingerSettings

CONFIGS = Path(__file__).parents[2] / "configs"


def test_a_pad_is_pressed_on_the_papers_grid_and_elsewhere_for_calibration() -> None:
    bed = build_bed(load(CONFIGS / "pad.toml"), grid=10, seed=1)
    assert isinstance(bed.plan, PadPlan) and bed.fitted_to == 5 and len(bed.names) == 105
    assert len(set(bed.names)) == 105 and bed.equilibria == 315
    places = 1e3 * np.array([touch.at for touch in bed.plan.touches])
    along = np.linspace(-28, 28, 10)
    np.testing.assert_allclose(np.unique(places[5:].round(9), axis=0), [(x, y) for x in along for y in along])
    assert all(touch.forces == (5.0, 10.0, 15.0) for touch in bed.plan.touches)
    apart = np.linalg.norm(places[:5, None] - places[None, 5:], axis=2)
    assert apart.min() > 1.0


def test_another_seed_is_another_pad() -> None:
    config = load(CONFIGS / "pad.toml")
    one, same, other = (build_bed(config, grid=2, seed=seed).plan for seed in (1, 1, 2))
    assert one.settings == same.settings != other.settings
    assert one.settings.shear_modulus != other.settings.shear_modulus
    drawn = 0.6e6 / 2 / 1.49
    for plan in (one, other):
        assert 0.9 * drawn <= plan.settings.shear_modulus <= 1.1 * drawn and plan.settings.layer > 0


def test_a_finger_is_pushed_as_in_table_iii() -> None:
    bed = build_bed(load(CONFIGS / "finger.toml"), grid=10, seed=1)
    assert isinstance(bed.plan, FingerPlan) and bed.fitted_to == 0
    assert bed.plan.pushes == TABLE_III and bed.names == ("push_0", "push_1", "push_2", "push_3")
    usual = FingerSettings()
    assert bed.plan.settings.wall_size == pytest.approx(usual.wall_size)
    assert bed.plan.settings.patch_points == usual.patch_points


def test_a_body_that_is_none_of_both_is_told(tmp_path: Path) -> None:
    text = (CONFIGS / "pad.toml").read_text()
    path = tmp_path / "blind.toml"
    path.write_text(text[: text.index("[sensors.flow]")])
    with pytest.raises(ConfigError, match="sensors: missing"):
        build_bed(load(path), grid=10, seed=1)
