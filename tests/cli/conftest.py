"""Commands that run within the tests, on coarse bodies."""

from collections.abc import Callable
from pathlib import Path

import pytest

from softfuse.cli import main


@pytest.fixture(scope="session")
def code_of() -> Callable[..., int]:
    """Runs softfuse with the arguments given and returns its exit code."""

    def run(*arguments: str | Path) -> int:
        with pytest.raises(SystemExit) as caught:
            main([*map(str, arguments)])
        assert isinstance(caught.value.code, int)
        return caught.value.code

    return run
