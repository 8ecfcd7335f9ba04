"""softfuse design on a coarse pad: a search, its folder, its robot, its mould and its report."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from softfuse.design.problem import Value
from softfuse.design.search import Trial
from softfuse.report.design_page import across_meshes
from softfuse.robot.file import load
from softfuse.robot.mesh import build_mesh

PLAN = (Path(__file__).parents[2] / "configs" / "design_pad.toml").read_text(encoding="utf-8")


@pytest.fixture
def plan(coarse: Path, tmp_path: Path) -> Path:
    """The example with a few presses, meshes and iterations."""
    text = PLAN
    for key, value in (
        ("robot", f'"{coarse}"'),
        ("count", "[3, 2]"),
        ("starts", "0"),
        ("legs", "2"),
        ("iterations", "2"),
        ("edges", "{}"),
        ("finer", "1.0"),
    ):
        text, found = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        assert found == 1, key
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


@pytest.mark.slow
def test_starts_are_searched_by_workers_as_here(code_of: Callable, plan: Path, tmp_path: Path) -> None:
    text = (
        plan.read_text(encoding="utf-8").replace("starts = 0", "starts = 1").replace("legs = 2", "legs = 1")
    )
    text = text.replace("followed = 1", "followed = 2").replace("at_least = [0.7]", "at_least = [0.6, 0.7]")
    plan.write_text(text, encoding="utf-8")
    histories = []
    for name, more in (("here", ()), ("workers", ("--workers", "2"))):
        assert code_of("design", plan, "--out", tmp_path / name, "--quiet", *more) == 0
        rows = pq.read_table(tmp_path / name / "history.parquet").to_pylist()
        histories.append(sorted(rows, key=lambda row: row["search"]))
    here, there = histories
    searches = {"as drawn", "start 0", "softness at_least 0.6", "softness at_least 0.7"}
    assert {row["search"] for row in here} == searches
    assert [row["search"] for row in there] == [row["search"] for row in here]
    for mine, theirs in zip(here, there, strict=True):
        # Threads add in another order: a nanometre is nothing, of measures some parts of a million.
        for name in mine:
            if name.startswith("parameter "):
                assert theirs[name] == pytest.approx(mine[name], abs=1e-9)
            if name.startswith("measure "):
                assert theirs[name] == pytest.approx(mine[name], rel=1e-5)


def test_jumps_are_those_of_layouts_that_two_meshes_have() -> None:
    def trial(leg: int, theta: float, *measures: float) -> tuple[str, Trial]:
        value = Value(np.array(measures), np.zeros((2, 1))) if measures else None
        return "as drawn", Trial(leg, np.array([theta]), value)

    trials = [
        trial(0, 0.0, 2.0, 5.0),
        trial(0, 1.0, 1.0, 4.0),
        trial(0, 2.0),
        trial(1, 1.0, 1.02, 3.0),
        trial(1, 0.5, 0.9, 3.0),
        ("start 0", trial(1, 0.0, 3.0, 5.0)[1]),
    ]
    ((name, leg, parts),) = across_meshes(trials)
    assert (name, leg) == ("as drawn", 1)
    np.testing.assert_allclose(parts, [0.02, 0.25])


def test_workers_are_here_or_behind_a_scheduler(
    code_of: Callable, plan: Path, tmp_path: Path, capsys
) -> None:
    given = ("design", plan, "--out", tmp_path / "run", "--workers", "2", "--scheduler", "tcp://127.0.0.1:1")
    assert code_of(*given) == 2
    assert "give one" in capsys.readouterr().err


def test_a_plan_that_names_what_is_not_there_is_told(
    code_of: Callable, plan: Path, tmp_path: Path, capsys
) -> None:
    plan.write_text(plan.read_text(encoding="utf-8").replace('value = "x"', 'value = "width"', 1))
    assert code_of("design", plan, "--out", tmp_path / "run") == 2
    assert "parameter[0].adds[0].value" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
