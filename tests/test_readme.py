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


def test_the_example_presses(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    names = ran(0, monkeypatch)
    volumes, w_va = np.asarray(names["volumes"]), np.asarray(names["w_va"])
    # The chamber under the press closes most; one beside it may grow.
    assert w_va.shape == (4, 1) and w_va.min() < -1e-8 and np.abs(w_va).max() == -w_va.min()
    # Softer the less a chamber is closed already: a secant is between slopes.
    np.testing.assert_allclose(volumes, 5.0 * w_va[:, 0], rtol=0.1, atol=1e-9)
    assert capsys.readouterr().out.startswith("[")


def test_the_example_tracks(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    found = ran(1, monkeypatch)["found"]
    assert found.touching.any() and np.isfinite(found.contact_force_N).all()
    assert capsys.readouterr().out


def test_the_first_example_is_short() -> None:
    assert len(EXAMPLES[0].strip().splitlines()) <= 12
    assert [line for line in EXAMPLES[0].splitlines() if line.startswith(("import", "from"))] == [
        "import numpy as np",
        "import softfuse as sf",
    ]


@pytest.mark.slow
def test_a_design_of_ones_own_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ran(2, monkeypatch)
    found, problem = names["best"], names["problem"]
    assert found.kept and found.trials > 1
    first = problem.on_mesh(problem.layout.start).measures(problem.layout.start)
    assert found.best.value.measures[0] < first[0] < 0.0
