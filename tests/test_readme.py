"""The README's example runs as it stands."""

import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


def test_the_example_finds_the_force(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    monkeypatch.chdir(ROOT)
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)
    np.testing.assert_allclose(names["found"].drive, names["force"], rtol=1e-4)
    assert names["w_va"].shape == (4, 1) and float(names["w_va"].min()) < 0
    assert capsys.readouterr().out.startswith("[")
