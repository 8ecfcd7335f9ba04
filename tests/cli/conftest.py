"""Commands that run within the tests, on coarse bodies."""

from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.cli import main

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="session")
def code_of() -> Callable[..., int]:
    """Runs softfuse with the arguments given and returns its exit code."""

    def run(*arguments: str | Path) -> int:
        with pytest.raises(SystemExit) as caught:
            main([*map(str, arguments)])
        assert isinstance(caught.value.code, int)
        return caught.value.code

    return run


@pytest.fixture(scope="session")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pad's config on the coarsest mesh, which is compiled soonest."""
    text = (CONFIGS / "pad.toml").read_text()
    for key, value in (("surface_size", "30 mm"), ("base_size", "28 mm"), ("fine_depth", "0 mm")):
        start = text.index(f"{key} = ")
        end = text.index('"', text.index('"', start) + 1)
        text = f'{text[:start]}{key} = "{value}{text[end:]}'
    path = tmp_path_factory.mktemp("config") / "coarse.toml"
    path.write_text(text)
    return path
