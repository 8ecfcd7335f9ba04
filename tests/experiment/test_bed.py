"""The paper's test beds: of which body, what is done to it, and what its kept equilibria are called."""

from pathlib import Path

import numpy as np
import pytest

from softfuse.errors import ConfigError
from softfuse.experiment.paper.bed import build_bed
from softfuse.experiment.paper.pushes import TABLE_III
from softfuse.robot.file import load
from softfuse.robot.layout.layout_source import LayoutSource
from softfuse.robot.settings import RobotSettings

SHAPE = """
[[body.source.shape]]
profile = "superellipsoid"
half = ["13 mm", "12 mm", "3 mm"]
roundness = 0.4
"""


@pytest.fixture
def layout(coarse: Path, tmp_path: Path) -> RobotSettings:
    """The coarse pad with chambers of another shape."""
    text = coarse.read_text(encoding="utf-8")
    for old, new in (
        ('type = "pad" ', 'type = "layout" '),
        ('cavity_size = ["28 mm", "28 mm", "6 mm"]', ""),
        ("\n# One material", f"{4 * SHAPE}\n# One material"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path / "layout.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def test_a_pad_is_made_as_drawn_but_is_not_the_estimators_model(layout: RobotSettings) -> None:
    one, same, other = (build_bed(layout, grid=2, seed=seed) for seed in (1, 1, 2))
    drawn, made = layout.body.source, one.robot.made.settings
    assert isinstance(drawn, LayoutSource) and isinstance(made.body.source, LayoutSource)
    assert made.body.source.shapes == drawn.shapes
    assert made.body.source.surface_size < drawn.surface_size
    assert made.body.materials[0].law == "yeoh"
    assert [chamber.centre for chamber in made.chambers] == [each.centre for each in layout.chambers]
    shifts = [[chamber.shift for chamber in bed.robot.made.settings.chambers] for bed in (one, same, other)]
    assert shifts[0] == shifts[1] != shifts[2]
    assert np.abs(shifts[0]).max() > 0.0


def test_a_pad_is_pressed_for_calibration_and_on_a_grid(layout: RobotSettings) -> None:
    bed = build_bed(layout, grid=2, seed=1)
    assert (bed.fitted_to, len(bed.names), bed.equilibria, bed.pushes) == (5, 9, 27, False)
    assert bed.names[4:6] == ("calibration_4", "press_000")


def test_a_finger_is_pushed_as_in_the_paper(linear_finger) -> None:
    settings = load(linear_finger())
    bed = build_bed(settings, grid=10, seed=1)
    assert bed.pushes and bed.fitted_to == 0 and len(bed.names) == len(TABLE_III)
    made = bed.robot.made.settings.body.source
    assert made.wall_size == pytest.approx(6e-3) and made.base_size == pytest.approx(9e-3)
    assert 0.0 < abs(made.neck_height - settings.body.source.neck_height) <= 0.2e-3
    bare = settings.model_copy(update={"sensors": ()})
    with pytest.raises(ConfigError, match="sensor: a finger is pushed where it has electrodes"):
        build_bed(bare, grid=10, seed=1)


def test_other_bodies_have_no_test_bed() -> None:
    dome = load(Path(__file__).parents[2] / "configs" / "dome.toml")
    with pytest.raises(ConfigError, match="body.source.type: the paper has pads and a finger"):
        build_bed(dome, grid=2, seed=1)
