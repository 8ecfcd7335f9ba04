"""Distances across cavities: between the walls of a box, at rest and squeezed."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.facing import Facing
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities

SIZE = np.array([0.028, 0.02, 0.006])


@pytest.fixture(scope="module")
def box():
    geometry = PadGeometry((0.06, 0.05, 0.018), tuple(SIZE), ((0.0, 0.0),), 0.006)
    mesh = pad_mesh(geometry, 0.004, 0.004)
    return mesh.nodes, cavities(mesh, geometry.centres())[0].faces


def test_from_wall_to_wall_it_is_the_size_of_the_box(box) -> None:
    nodes, faces = box
    facing = Facing.of(nodes, [faces])
    for axis, size in enumerate(SIZE):
        straight = np.abs(np.asarray(facing.normal)[:, axis]) > 1.0 - 1e-9
        assert straight.sum() > 0
        np.testing.assert_allclose(facing.gaps(jnp.asarray(nodes))[straight], size, rtol=1e-12)


def test_a_cavity_that_is_pressed_flat_has_no_gap(box) -> None:
    nodes, faces = box
    facing = Facing.of(nodes, [faces])
    upright = np.abs(np.asarray(facing.normal)[:, 2]) > 1.0 - 1e-9
    low, high = 0.006, 0.012
    for left in (0.5, 0.0):
        z = np.where(nodes[:, 2] < high, nodes[:, 2], low + left * (nodes[:, 2] - low))
        moved = np.column_stack([nodes[:, :2], z])
        np.testing.assert_allclose(facing.gaps(jnp.asarray(moved))[upright], left * 0.006, atol=1e-15)


def test_several_cavities_are_one_after_the_other(box) -> None:
    nodes, faces = box
    once, twice = (len(Facing.of(nodes, [faces] * count).node) for count in (1, 2))
    assert twice == 2 * once > 0
