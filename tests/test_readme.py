"""The README's examples run as they stand."""

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)


def ran(number: int, monkeypatch: pytest.MonkeyPatch) -> dict:
    """What an example has defined, run from the top of the repository."""
    monkeypatch.chdir(ROOT)
    names: dict = {"__name__": "example"}
    exec(compile(EXAMPLES[number], "README.md", "exec"), names)
    return names


def test_the_example_finds_the_force(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    names = ran(0, monkeypatch)
    np.testing.assert_allclose(names["found"].drive, names["force"], rtol=1e-4)
    assert names["w_va"].shape == (4, 1) and float(names["w_va"].min()) < 0
    assert capsys.readouterr().out.startswith("[")


@pytest.mark.slow
def test_a_design_of_ones_own_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ran(1, monkeypatch)
    found, problem = names["best"], names["problem"]
    assert found.kept and found.trials > 1
    first = problem.on_mesh(problem.layout.start).measures(problem.layout.start)
    assert found.best.value.measures[0] < first[0] < 0.0
