"""softfuse evaluate of a body whose chambers are of different shapes, from its config to its report."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.robot.file import load

CONFIGS = Path(__file__).parents[2] / "configs"
SOURCE = """[body.source]
type = "layout"
size = ["80 mm", "80 mm", "18 mm"]
surface_size = "20 mm"
growth = 0.5
base_size = "20 mm"
[[body.source.shape]]
profile = "rounded-box"
half = ["14 mm", "13 mm", "3 mm"]
turn = ["0 deg", "0 deg", "5 deg"]
fillet = "1 mm"
[[body.source.shape]]
profile = "superellipsoid"
half = ["14 mm", "14 mm", "3 mm"]
roundness = 0.3
[[body.source.shape]]
profile = "superellipsoid"
half = ["13 mm", "14 mm", "3 mm"]
roundness = 0.4
harmonics = [0.0, 0.0, 0.02, 0.0, 0.01]
[[body.source.shape]]
profile = "rounded-box"
half = ["14 mm", "14 mm", "3 mm"]
fillet = "0.5 mm"

"""


@pytest.mark.slow
def test_a_layout_is_evaluated_as_a_pad_is(code_of: Callable[..., int], tmp_path: Path) -> None:
    text = (CONFIGS / "pad.toml").read_text(encoding="utf-8")
    start, end = text.index("[body.source]"), text.index("# One material")
    config, out = tmp_path / "layout.toml", tmp_path / "out"
    config.write_text(text[:start] + SOURCE + text[end:], encoding="utf-8")
    assert code_of("evaluate", config, "--out", out, "--grid", "2", "--quiet") == 0
    _, *rows = csv.reader((out / "tables" / "table_2.csv").read_text().splitlines())
    drawn, calibrated = (float(rows[0][k]) for k in (2, 4))
    # A coarse body of other stiffness than the test bed's, which may be 10 % off; fitted to five presses.
    assert calibrated < drawn < 25 and calibrated < 10
    fitted = load(out / "fitted.toml")
    assert fitted.body.source == load(config).body.source
    moved = np.array([chamber.shift for chamber in fitted.chambers])
    assert 0 < np.abs(moved).max() < 1.5e-3
