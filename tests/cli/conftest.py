"""Commands that run within the tests, on coarse bodies."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.cli import main
from softfuse.mesh.files import write_mesh
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.tetmesh import tet_mesh

BAR = """
[robot]
name = "bar"

[body]
element = "linear"
source = {type = "mesh", file = "bar.vtu", unit = "mm"}
fixed = {x = ["0 mm", "0 mm"]}
material = [{law = "neo-hookean", young = "100 kPa", poisson = 0.45}]

[[cable]]
name = "c"
guides = [["5 mm", "5 mm", "7 mm"], ["15 mm", "5 mm", "7 mm"]]
pulled_at = ["-5 mm", "5 mm", "7 mm"]
max_tension = "200 N"
"""


@pytest.fixture
def bar(tmp_path: Path) -> Path:
    """A bar of 20 x 10 x 10 mm with a cable along it, as a file."""
    planes = np.linspace(0, 20, 5), np.linspace(0, 10, 3), np.linspace(0, 10, 3)
    grid = kuhn_grid(planes, np.ones((4, 2, 2), bool), (0, 0, 0))
    write_mesh(tmp_path / "bar.vtu", tet_mesh(grid.nodes, grid.tets))
    (tmp_path / "bar.toml").write_text(BAR)
    return tmp_path / "bar.toml"


@pytest.fixture(scope="session")
def code_of() -> Callable[..., int]:
    """Runs softfuse with the arguments given and returns its exit code."""

    def run(*arguments: str | Path) -> int:
        with pytest.raises(SystemExit) as caught:
            main([*map(str, arguments)])
        assert isinstance(caught.value.code, int)
        return caught.value.code

    return run
