"""Presses of a real force: at a small one they are the answers at rest, and strains grow with it."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.facing import Facing
from softfuse.design.straining import largest_strain
from softfuse.design.verification import pressed
from softfuse.errors import SolveError
from softfuse.estimation.rest_response import rest_response
from softfuse.functional.chart import facing
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot

PLACES = jnp.asarray(facing(np.array([[0.012, -0.015, 0.0], [-0.01, 0.016, 0.0]]), (0, 0, -1)))


@pytest.fixture(scope="module")
def pad(coarse):
    """The pad on the coarsest mesh."""
    robot = build_robot(load(coarse))
    return robot.model, [wall.faces for wall in robot.mesh.cavities]


@pytest.mark.slow
def test_a_small_force_is_answered_as_at_rest(pad) -> None:
    device, walls = pad
    counted = []
    found = pressed(device, walls, PLACES, 1e-3, seen=lambda: counted.append(1))
    answer = rest_response(device, PLACES)
    size = float(jnp.max(jnp.abs(answer.by_force)))
    np.testing.assert_allclose(found.by_force, answer.by_force, rtol=0, atol=1e-3 * size)
    np.testing.assert_allclose(found.softness, answer.softness, rtol=1e-3)
    facing = Facing.of(np.asarray(device.body.rest), walls)
    apart = facing.gaps(device.body.rest)
    for k, moved in enumerate(answer.motion):
        closing = float(jnp.max(-facing.gaps(moved) / apart))
        assert (1.0 - found.open_part[k]) / 1e-3 == pytest.approx(closing, rel=1e-3)
        strain = float(largest_strain(device.body, moved))
        assert (found.stretch[k] - 1.0) / 1e-3 == pytest.approx(strain, rel=1e-3)
    assert len(counted) == len(PLACES)


def test_harder_presses_close_cavities_and_stretch_walls(pad) -> None:
    device, walls = pad
    soft, hard = (pressed(device, walls, PLACES, force) for force in (1.0, 5.0))
    assert (hard.open_part < soft.open_part).all() and (hard.open_part > 0.0).all()
    assert (hard.stretch > soft.stretch).all() and (soft.stretch > 1.0).all()


def test_a_press_without_equilibrium_is_told(pad) -> None:
    device, walls = pad
    with pytest.raises(SolveError, match="no equilibrium under 5000 N"):
        pressed(device, walls, PLACES[:1], 5000.0)
