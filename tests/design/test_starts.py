"""Random starts can be made, and are the same for the same seed."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.problem import Geometry, Walls
from softfuse.design.starts import nearest_that_can_be_made, random_starts
from softfuse.errors import SoftfuseError
from softfuse.robot.layout.thickness import slacks, wall_thicknesses

LEAST_M = 0.004


@pytest.fixture(scope="module")
def geometry(twins) -> Geometry:
    return Geometry(twins, Walls(LEAST_M, {}))


def test_walls_are_thick_enough_and_bounds_are_kept(twins, geometry) -> None:
    starts = random_starts(twins, geometry, 3, seed=4)
    for theta in starts:
        assert (theta >= twins.lower).all() and (theta <= twins.upper).all()
        assert wall_thicknesses(twins, jnp.asarray(theta)).min() >= LEAST_M
        assert slacks(twins, jnp.asarray(theta)).min() >= 0.0
    assert np.ptp(starts, axis=0).min() > 0.0
    np.testing.assert_array_equal(random_starts(twins, geometry, 3, seed=4), starts)


def test_a_layout_that_can_be_made_stays_as_it_is(twins, geometry) -> None:
    np.testing.assert_allclose(
        nearest_that_can_be_made(twins, geometry, twins.start), twins.start, atol=1e-12
    )


@pytest.mark.slow
def test_walls_that_nothing_allows_are_told(twins) -> None:
    with pytest.raises(SoftfuseError, match="only 0 of"):
        random_starts(twins, Geometry(twins, Walls(0.012, {})), 1, seed=0, tries=2)
