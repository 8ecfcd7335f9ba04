"""Points, bending and patches of a block whose displacement grows in proportion to the height."""

from dataclasses import replace

import numpy as np
import pytest

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.robot.posture import Posture, Watched
from softfuse.functional.chart import facing
from softfuse.functional.material_points import MaterialPoints
from softfuse.functional.pressure_cells import uniform
from softfuse.material import NeoHookean
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.model import Model
from softfuse.mechanics.patch import PatchContact
from softfuse.mechanics.solution import State
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import outer_surface

MM = 1e-3
SLOPE = np.array([0.3, -0.2, 0.1])
"""Displacement over height."""
CHAIN = MM * np.array([[0.0, 0, 0], [0, 0, 8], [0, 0, 18]])
POINTS = MM * np.array([[31.0, 4, 13], [0, -15, 9]])
MIDDLES = MM * np.array([[[0.0, 2, 18], [5, 2, 18]], [[35, 0, 9], [35, 5, 9]]])
ARMS = (-2.5 * MM, 2.5 * MM)
INTO = ((0, 0, -1.0), (-2.0, 0, 0))
PLACES = np.array([facing(pair.mean(axis=0), into) for pair, into in zip(MIDDLES, INTO, strict=True)])


@pytest.fixture(scope="module")
def device() -> Model:
    """A block of 70 × 40 × 18 mm, held at its bottom, with patches on its top and on its right side."""
    geometry = PadGeometry(
        (70 * MM, 40 * MM, 18 * MM), (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0),), 6 * MM
    )
    mesh = mesh_for(LINEAR, pad_mesh(geometry, 40 * MM, 40 * MM))
    law = NeoHookean.from_young(0.6e6, 0.3)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=LINEAR)
    contact = PatchContact.on(outer_surface(mesh).faces, uniform(), 3 * MM, ARMS)
    return Model(body, (), (contact,), Dense.plan(body))


def watched(device: Model, points: np.ndarray, chain: np.ndarray | None) -> Watched:
    """What is watched on the block."""
    body, (contact,) = device.body, device.contacts
    assert isinstance(contact, PatchContact)
    line = None if chain is None else MaterialPoints.embedded(body, chain)
    at = MaterialPoints.embedded(body, points)
    return Watched.on(device, at, line, np.asarray(contact.faces), PLACES, ARMS)


def sheared(device: Model) -> State:
    """The state in which each point is displaced by its height times the slope."""
    body, rest = device.body, device.rest_state(PLACES[:1])
    moved = body.rest[:, 2:] * SLOPE
    return replace(rest, z=rest.z.at[body.displacement_index].set(moved, mode="drop"))


@pytest.fixture(scope="module")
def posture(device: Model) -> Posture:
    return watched(device, POINTS, CHAIN).posture(sheared(device))


def test_points_and_patches_move_with_the_body(posture: Posture) -> None:
    np.testing.assert_allclose(posture.point_m, POINTS + POINTS[:, 2:] * SLOPE, atol=1e-12)
    np.testing.assert_allclose(posture.patch_m, MIDDLES + MIDDLES[..., 2:] * SLOPE, atol=1e-12)


def test_the_base_bends_and_what_stays_straight_does_not(posture: Posture) -> None:
    tilt = np.arctan2(np.hypot(*SLOPE[:2]), 1 + SLOPE[2])
    np.testing.assert_allclose(posture.turn, [tilt, 0.0], atol=1e-9)
    np.testing.assert_allclose(posture.curvature, [tilt / (8 * MM), 0.0], atol=1e-6)
    np.testing.assert_allclose(posture.tip_turn, tilt, rtol=1e-9)


def test_normals_turn_with_the_surface(posture: Posture) -> None:
    # What is level stays level; normals of the side are perpendicular to y and to what was upright.
    side = np.cross([0, 1.0, 0], np.array([0, 0, 1.0]) + SLOPE)
    np.testing.assert_allclose(posture.inward[0], np.tile([0, 0, -1.0], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(posture.inward[1], np.tile(-side / np.linalg.norm(side), (2, 1)), atol=1e-12)


def test_nothing_needs_to_be_watched_besides_patches(device: Model) -> None:
    found = watched(device, np.zeros((0, 3)), None).posture(sheared(device))
    assert found.point_m.shape == (0, 3) and found.turn.shape == (0,) and np.isnan(found.tip_turn)
    assert found.answers.shape == (0,)


def test_what_is_unknown_keeps_its_size(posture: Posture) -> None:
    unknown = posture.unknown()
    assert unknown.point_m.shape == posture.point_m.shape and np.isnan(unknown.patch_m).all()
