"""softfuse design on a coarse pad: a search, its folder, its device, its mould and its report."""

from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from softfuse.config import load
from softfuse.config.build_mesh import build_mesh

PLAN = (Path(__file__).parents[2] / "configs" / "design_pad.toml").read_text(encoding="utf-8")


@pytest.fixture
def plan(coarse: Path, tmp_path: Path) -> Path:
    """The example with a few presses, meshes and iterations."""
    text = PLAN
    for old, new in (
        ('device = "pad.toml"', f'device = "{coarse}"'),
        ("count = [10, 5]", "count = [3, 2]"),
        ("starts = 3", "starts = 0"),
        ("legs = 5", "legs = 2"),
        ("iterations = 12", "iterations = 2"),
        ("finer = 1.4", "finer = 1.0"),
    ):
        assert old in text
        text = text.replace(old, new)
    text = text.replace("[verify]", '[front]\nof = { measure = "softness" }\nat_least = [0.7]\n\n[verify]')
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_run_ends_with_a_device_that_is_better(
    code_of: Callable, plan: Path, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "run"
    assert code_of("design", plan, "--out", out) == 0
    said = capsys.readouterr().out
    assert "unevenness" in said and "designed" in said
    history = pq.read_table(out / "history.parquet").to_pylist()
    first, best = history[0]["measure 0 unevenness"], min(row["measure 0 unevenness"] for row in history)
    assert best < first
    assert {row["search"] for row in history} == {"as drawn", "softness at_least 0.7"}
    designed = load(out / "designed.toml")
    assert len(build_mesh(designed).cavities) == 4
    files = {path.name for path in (out / "casting").iterdir()}
    assert {"body.stl", "mould_lower.stl", "mould_upper.stl"} <= files
    assert sum(name.startswith("core_") for name in files) == 4
    report = (out / "report.html").read_text(encoding="utf-8")
    for heading in (
        "Before and after",
        "Looked at again",
        "Cavities",
        "Walls",
        "Searches",
        "Casting",
        "Tried",
    ):
        assert f"<h2>{heading}" in report
    # Run again, nothing is tried anew.
    assert code_of("design", plan, "--out", out, "--quiet") == 0
    assert pq.read_table(out / "history.parquet").to_pylist() == history
    other = plan.with_name("other.toml")
    other.write_text(plan.read_text(encoding="utf-8").replace("at_least = 0.4", "at_least = 0.3"))
    assert code_of("design", other, "--out", out) == 2
    assert "another plan" in capsys.readouterr().err


def test_a_plan_that_names_what_is_not_there_is_told(
    code_of: Callable, plan: Path, tmp_path: Path, capsys
) -> None:
    plan.write_text(plan.read_text(encoding="utf-8").replace('value = "x"', 'value = "width"', 1))
    assert code_of("design", plan, "--out", tmp_path / "run") == 2
    assert "parameter[0].adds[0].value" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
