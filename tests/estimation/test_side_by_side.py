"""Work shared out over cores: in order, and ended when it is not wanted any more."""

import threading
import time

import numpy as np
import pytest

from softfuse.estimation.batch import cores, shared_out, side_by_side


def test_what_is_found_comes_in_order() -> None:
    def late(k: int) -> int:
        time.sleep(0.01 * (3 - k % 4))
        return k * k

    assert list(shared_out(late, range(20))) == [k * k for k in range(20)]
    square, cube = side_by_side(lambda k: (k**2, k**3), np.arange(5))
    np.testing.assert_array_equal(square, np.arange(5) ** 2)
    np.testing.assert_array_equal(cube, np.arange(5) ** 3)


def test_a_failure_ends_what_has_not_begun() -> None:
    begun = []

    def one(k: int) -> int:
        begun.append(k)
        time.sleep(0.01)
        if k == 0:
            raise ValueError("no")
        return k

    with pytest.raises(ValueError, match="no"):
        list(shared_out(one, range(1000)))
    assert len(begun) < 100


def test_as_many_at_a_time_as_there_are_cores() -> None:
    together = threading.Barrier(cores(), timeout=30)
    list(shared_out(lambda _: together.wait(), range(cores())))
