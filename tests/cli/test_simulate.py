"""softfuse simulate."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.mesh.files import read_mesh

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"


def test_numbers_and_shape_are_written(code_of: Callable[..., int], tmp_path: Path) -> None:
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    given = ("--contact", "uniform", "--at", "10,-6", "--force", "5", "--quiet")
    assert code_of("simulate", PAD, *given, "--json", numbers, "--vtu", shape) == 0
    found = json.loads(numbers.read_text())
    assert set(found) == {
        "force_N",
        "depth_mm",
        "volume_change_mm3",
        "nodes",
        "dof",
        "newton_iterations",
        "residual_N",
        "result",
        "reached",
        "state",
    }
    assert found["result"] == "converged" and found["force_N"] == pytest.approx(5.0)
    assert found["nodes"] <= 5000 and found["residual_N"] < 1e-9
    assert len(read_mesh(shape).nodes) == found["nodes"]
    # tests/data/pad_converged.json tells where these come from: high-order displacements, from below.
    np.testing.assert_allclose(found["volume_change_mm3"][2], -316.8, rtol=0.03)


def test_a_search_that_fails_says_how_far_it_came_and_keeps_that_state(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """And from what it kept the way goes on."""
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    press = ("simulate", PAD, "--contact", "uniform", "--at", "10,-6", "--quiet")
    assert code_of(*press, "--force", "3000", "--json", numbers, "--vtu", shape) == 1
    found = json.loads(numbers.read_text())
    assert found["result"] in ("inverted", "diverged", "step_limit") and found["residual_N"] < 1e-6
    assert 0 < found["reached"] < 1
    assert found["force_N"] == pytest.approx(3000 * found["reached"])
    err = capsys.readouterr().err
    assert f"{100 * found['reached']:.3g} % of the way" in err and str(shape) in err
    assert len(read_mesh(shape).nodes) == found["nodes"]
    again = tmp_path / "again.json"
    force = repr(found["force_N"])
    assert code_of(*press, "--force", force, "--start", numbers, "--json", again) == 0
    kept = json.loads(again.read_text())
    assert kept["newton_iterations"] <= 2 and kept["depth_mm"] == pytest.approx(found["depth_mm"])
    assert code_of(*press, "--force", "5", "--start", shape) == 1
    assert "no state to begin with" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("at", "told"),
    [
        ("35,0", "overhangs the surface, which spans x -40 to 40 mm"),
        ("somewhere", "is not a place: give X,Y in mm"),
    ],
)
def test_a_wrong_place_is_one_line(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str], at: str, told: str
) -> None:
    assert code_of("simulate", PAD, "--at", at, "--force", "5") == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1
