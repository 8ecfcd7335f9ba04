"""How solves end, by name, as rows of a sweep tell it."""

import pytest

from softfuse.mechanics.solution import RESULTS, result_name

NAMES = ("converged", "diverged", "snapped", "inverted", "step_limit")


@pytest.mark.parametrize("name", NAMES)
def test_a_result_has_its_name(name: str) -> None:
    assert result_name(getattr(RESULTS, name)) == name


def test_there_are_no_other_results() -> None:
    assert len(RESULTS) == len(NAMES)
