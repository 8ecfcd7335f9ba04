"""Commands that run within the tests, and leave no programs in the user's cache folder."""

from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import pytest

from softfuse.cli import main

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A cache folder of the test's own, forgotten afterwards."""
    folder: Path = tmp_path_factory.mktemp("cache")
    for name in ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(folder))
    yield
    jax.config.update("jax_compilation_cache_dir", None)


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
