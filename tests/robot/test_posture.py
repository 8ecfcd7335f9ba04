"""Points, bending, chambers and contacts of a block whose displacement grows in proportion to the height."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from checks import stand_in

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.material_points import MaterialPoints
from softfuse.material import NeoHookean
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.robot.posture import Posture, Watched

MM = 1e-3
SLOPE = np.array([0.3, -0.2, 0.1])
"""Displacement over height."""
CHAIN = MM * np.array([[0.0, 0, 0], [0, 0, 8], [0, 0, 18]])
POINTS = MM * np.array([[31.0, 4, 13], [0, -15, 9]])
MIDDLES = MM * np.array([[5.0, 2, 18], [35, 0, 9]])
INTO = np.array([[0, 0, -1.0], [-2.0, 0, 0]])


@pytest.fixture(scope="module")
def robot() -> Any:
    """A block of 70 × 40 × 18 mm with a chamber, held at its bottom."""
    geometry = PadGeometry(
        (70 * MM, 40 * MM, 18 * MM), (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0),), 6 * MM
    )
    mesh = mesh_for(LINEAR, pad_mesh(geometry, 40 * MM, 40 * MM))
    law = NeoHookean.from_young(0.6e6, 0.3)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=LINEAR)
    (wall,) = cavities(mesh, geometry.centres())
    chamber = stand_in(cavity=Cavity(jnp.asarray(wall.faces)))
    parts = stand_in(faces=outer_surface(mesh).faces, chambers={"only": chamber})
    model = Model(body, (), (), Dense.plan(body))
    return stand_in(
        model=model,
        parts=parts,
        points=lambda: MaterialPoints.embedded(body, POINTS),
        centreline=lambda: MaterialPoints.embedded(body, CHAIN),
    )


def sheared(model: Model) -> State:
    """The state in which each point is displaced by its height times the slope."""
    body, rest = model.body, model.rest_state(())
    moved = body.rest[:, 2:] * SLOPE
    return replace(rest, z=rest.z.at[body.displacement_index].set(moved, mode="drop"))


@pytest.fixture(scope="module")
def posture(robot: Any) -> Posture:
    return Watched.on(robot).posture(sheared(robot.model))


def test_points_move_with_the_body(posture: Posture) -> None:
    np.testing.assert_allclose(posture.point_m, POINTS + POINTS[:, 2:] * SLOPE, atol=1e-12)
    np.testing.assert_allclose(posture.moved_m, 18 * MM * np.linalg.norm(SLOPE), rtol=1e-9)


def test_the_base_bends_and_what_stays_straight_does_not(posture: Posture) -> None:
    tilt = np.arctan2(np.hypot(*SLOPE[:2]), 1 + SLOPE[2])
    np.testing.assert_allclose(posture.turn, [tilt, 0.0], atol=1e-9)
    np.testing.assert_allclose(posture.curvature, [tilt / (8 * MM), 0.0], atol=1e-6)
    np.testing.assert_allclose(posture.tip_turn, tilt, rtol=1e-9)


def test_the_chamber_grows_as_much_as_the_block_is_stretched(posture: Posture) -> None:
    # A homogeneous deformation of determinant 1 + slope_z.
    np.testing.assert_allclose(posture.volume_m3, [SLOPE[2] * 26 * 28 * 6 * MM**3], rtol=1e-9)


def test_contacts_move_and_turn_with_the_surface(robot: Any) -> None:
    places = np.stack([facing(point, into) for point, into in zip(MIDDLES, INTO, strict=True)])
    off = facing(MM * np.array([90.0, 0, 18]), INTO[0])
    points, normals = Watched.on(robot).pressed(np.concatenate([places, off[None]]), sheared(robot.model))
    np.testing.assert_allclose(points[:2], MIDDLES + MIDDLES[:, 2:] * SLOPE, atol=1e-12)
    # What is level stays level; normals of the side are perpendicular to y and to what was upright.
    side = np.cross([0, 1.0, 0], np.array([0, 0, 1.0]) + SLOPE)
    np.testing.assert_allclose(normals[0], [0, 0, -1.0], atol=1e-12)
    np.testing.assert_allclose(normals[1], -side / np.linalg.norm(side), atol=1e-12)
    assert np.isnan(points[2]).all() and np.isnan(normals[2]).all()


def test_what_is_not_known_has_the_same_sizes(posture: Posture) -> None:
    unknown = posture.unknown()
    assert np.isnan(unknown.point_m).all() and unknown.point_m.shape == posture.point_m.shape
    assert np.isnan(unknown.tip_turn)
