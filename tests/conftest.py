"""Every test runs in double precision, as the mechanics requires; and the finger in coarse variants."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import pytest

jax.config.update("jax_enable_x64", True)

COARSE = (
    ('wall_size = "10 mm"', 'wall_size = "20 mm"'),
    ('base_size = "8 mm"', 'base_size = "30 mm"'),
    ("growth = 2.0", "growth = 9.0"),
)
LINEAR = (
    ('element = "taylor-hood"', 'element = "linear"'),
    # With a high Poisson's ratio linear elements lock.
    ("poisson = 0.49", "poisson = 0.3"),
)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache folder of the tests' own, where each finds the programs that others have compiled."""
    base = tmp_path_factory.getbasetemp()
    # Workers that test side by side share one.
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "cache"
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"):
            patch.setenv(name, str(folder))
        jax.config.update("jax_compilation_cache_dir", str(folder / "softfuse" / "jax"))
        yield


@pytest.fixture(scope="session")
def coarse_finger(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Writes configs/finger.toml with a coarse mesh and, `coarse_finger((old, new), ...)`, more replaced."""
    whole = (Path(__file__).parents[1] / "configs" / "finger.toml").read_text(encoding="utf-8")

    def write(*changes: tuple[str, str]) -> Path:
        text = whole
        for old, new in (*COARSE, *changes):
            assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the configuration"
            text = text.replace(old, new)
        path = tmp_path_factory.mktemp("finger") / "finger.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def linear_finger(coarse_finger: Callable[..., Path]) -> Callable[..., Path]:
    """The same with linear elements too, which compile and step in no time and are too stiff."""
    return lambda *changes: coarse_finger(*LINEAR, *changes)
