"""The same step with targets instead of readings: which cable brings the tip there, within what it can do.

A beam with one cable along its lower side and another along its left one; sensors are the tip's coordinates.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.estimation.limits import Limits, Rates, within_rates
from softfuse.estimation.step import Observation, exact_steps, strokes
from softfuse.functional import Marker, uniform
from softfuse.functional.chart import facing
from softfuse.functional.skin import Skin
from softfuse.material import NeoHookean
from softfuse.mechanics import RESULTS
from softfuse.mechanics.cable import PulledCable
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.indenters import SurfacePatches
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.reading import AnswerReading, ShapeReading
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import tet_mesh

LENGTH, SIDE = 0.06, 0.012
ALONG = (0.012, 0.027, 0.041, 0.055)
NOWHERE = jnp.zeros((0, 3, 3))
STEPS = 20


class Robot(NamedTuple):
    device: Model
    free: Limits


@pytest.fixture(scope="module")
def robot() -> Robot:
    planes = (np.linspace(0, LENGTH, 11), np.linspace(0, SIDE, 3), np.linspace(0, SIDE, 3))
    grid = kuhn_grid(planes, np.ones((10, 2, 2), bool), (0, 0, 0))
    mesh = mesh_for(LINEAR, oriented(tet_mesh(grid.nodes, grid.tets)))
    body = Body.from_mesh(mesh, [NeoHookean.from_young(3e5, 0.3)], mesh.nodes[:, 0] == 0.0, element=LINEAR)
    below = PulledCable.through(
        body, np.array([[x, 0.005, 0.002] for x in ALONG]), np.array([0, 0.005, 0.002])
    )
    left = PulledCable.through(
        body, np.array([[x, 0.010, 0.006] for x in ALONG]), np.array([0, 0.010, 0.006])
    )
    tip = Marker.of(body, np.array([LENGTH, SIDE, SIDE]))
    readings = (ShapeReading(tip), AnswerReading((0, 1)))
    skin = Skin.of(boundary_faces(mesh).faces, mesh.nodes, 4.5e-3)
    contact = SurfacePatches(skin, uniform(rings=3, angles=8), 0.003)
    device = Model(body, readings, (contact,), Dense.plan(body), (below, left))
    # A trace of regularisation keeps the cables that no target needs at rest.
    return Robot(device, Limits(jnp.zeros(2), jnp.full(2, 20.0), jnp.full(2, 1e-9), motion=jnp.array(3e-3)))


@pytest.fixture(scope="module")
def reached():
    """reached(device, limits, target, weight): state and report, compiled once for each kind of limits."""

    @eqx.filter_jit
    def go(device, limits, reading, weight):
        seen = Observation(reading, jnp.diag(weight), NOWHERE)
        return exact_steps(device, limits, device.rest_state(NOWHERE), seen, steps=STEPS)

    return go


def _forward(device: Model, tensions) -> jnp.ndarray:
    found = simulate(device, NOWHERE, jnp.asarray(tensions))
    assert found.result == RESULTS.converged
    return device.reading(found.state)


TIP_ONLY = jnp.array([1e3, 1e3, 1e3, 0.0, 0.0])


@pytest.mark.slow
def test_the_cables_bring_the_tip_where_it_was_seen(robot: Robot, reached) -> None:
    true = jnp.array([1.2, 0.5])
    target = _forward(robot.device, true)
    assert float(jnp.linalg.norm(target[:3])) > 5e-3
    state, report = reached(robot.device, robot.free, target, TIP_ONLY)
    np.testing.assert_allclose(state.drive, true, rtol=1e-6)
    assert float(jnp.max(jnp.abs(report.misfit[:3]))) < 1e-9


def test_an_unreachable_target_is_told_by_what_is_missing(robot: Robot, reached) -> None:
    """Cables cannot push: upwards and outwards the tip stays where it is, 8 and 3 mm short."""
    state, report = reached(robot.device, robot.free, jnp.array([0.0, 3e-3, 8e-3, 0, 0]), TIP_ONLY)
    np.testing.assert_allclose(state.drive[0], 0.0, atol=1e-9)
    assert float(report.kkt) < 1e-9
    assert float(jnp.linalg.norm(report.misfit[:3])) > 7e-3


@pytest.mark.slow
def test_a_cable_of_known_length_is_an_equality(robot: Robot, reached) -> None:
    """The cable below is 4 mm shorter whatever the target says; the other one does what it can."""
    endless = jnp.full(2, jnp.inf)
    known = (jnp.array([4e-3, -jnp.inf]), jnp.array([4e-3, jnp.inf]))
    limits = robot.free._replace(strokes=known)
    state, report = reached(robot.device, limits, jnp.array([0, -4e-3, 0, 0, 0.0]), TIP_ONLY)
    answer = robot.device.answers(state)
    np.testing.assert_allclose(answer[0], 4e-3, rtol=0, atol=1e-11)
    assert float(report.kkt) < 1e-9
    assert float(state.drive[0]) > 0.1
    unbound = robot.free._replace(strokes=(-endless, endless))
    same, _ = reached(robot.device, unbound, _forward(robot.device, [0.7, 0.1]), TIP_ONLY)
    np.testing.assert_allclose(same.drive, [0.7, 0.1], rtol=1e-6)


@pytest.mark.slow
def test_lengths_and_positions_weigh_against_each_other(robot: Robot, reached) -> None:
    """A length that contradicts the tip pulls the estimate towards it as its weight says."""
    reading = _forward(robot.device, [1.2, 0.0])
    wrong = reading.at[3].add(-1e-3)
    shortened = []
    for weight in (0.0, 1e3, 1e6):
        weights = TIP_ONLY.at[3].set(weight)
        state, _ = reached(robot.device, robot.free, wrong, weights)
        shortened.append(float(robot.device.answers(state)[0]))
    np.testing.assert_allclose(shortened[0], reading[3], rtol=1e-5)
    np.testing.assert_allclose(shortened[2], wrong[3], rtol=1e-5)
    assert shortened[2] < shortened[1] < shortened[0]


@pytest.mark.slow
def test_rates_let_a_cable_only_follow_slowly(robot: Robot, reached) -> None:
    device = robot.device
    target = _forward(device, [1.2, 0.5])
    rest = device.rest_state(NOWHERE)
    stroke = strokes(device, device.loads(NOWHERE), rest)
    rates = Rates(jnp.array([10.0, jnp.inf]), jnp.array([jnp.inf, 0.025]))
    limits = within_rates(robot.free, rates, rest.drive, stroke, jnp.array(0.02))
    state, report = reached(device, limits, target, TIP_ONLY)
    np.testing.assert_allclose(state.drive[0], 0.2, atol=1e-9)
    np.testing.assert_allclose(device.answers(state)[1], 5e-4, atol=1e-9)
    assert float(report.kkt) < 1e-8


def test_in_no_time_nothing_with_a_rate_changes(robot: Robot) -> None:
    """Neither does what cannot be reached in it; what has no rate may."""
    drive, stroke = jnp.array([0.4, 0.3]), jnp.array([1e-3, 2e-3])
    rates = Rates(jnp.array([10.0, jnp.inf]), jnp.array([jnp.inf, 0.025]))
    bounds = (jnp.array([5e-3, -jnp.inf]), jnp.array([6e-3, jnp.inf]))
    limits = within_rates(robot.free._replace(strokes=bounds), rates, drive, stroke, jnp.zeros(()))
    np.testing.assert_allclose(limits.lower, [0.4, 0.0])
    np.testing.assert_allclose(limits.upper, [0.4, 20.0])
    assert limits.strokes is not None
    np.testing.assert_allclose(limits.strokes[0], [5e-3, 2e-3])
    np.testing.assert_allclose(limits.strokes[1], [6e-3, 2e-3])


@pytest.mark.slow
def test_pushes_on_two_sides_are_told_apart(robot: Robot) -> None:
    """Two contacts along the current normals and no cable: the tip's coordinates tell both."""
    device = robot.device
    sides = (([0.045, SIDE, 0.006], (0, -1, 0)), ([0.045, 0.006, SIDE], (0, 0, -1)))
    places = jnp.array([facing(np.array(point), direction) for point, direction in sides])
    true = jnp.array([0.25, 0.15, 0.0, 0.0])
    limits = Limits(jnp.zeros(4), jnp.array([5.0, 5.0, 0.0, 0.0]), jnp.full(4, 1e-9), motion=jnp.array(3e-3))

    @eqx.filter_jit
    def found(device):
        seen = device.reading(simulate(device, places, true).state)
        observation = Observation(seen, jnp.diag(jnp.array([1e4, 1e4, 1e4, 0.0, 0.0])), places)
        return seen, exact_steps(device, limits, device.rest_state(places), observation, steps=STEPS)[0]

    seen, state = found(device)
    assert float(jnp.linalg.norm(seen[:3])) > 5e-3
    np.testing.assert_allclose(state.drive, true, rtol=1e-5, atol=1e-9)


@pytest.mark.slow
def test_a_contact_is_in_the_middle_of_its_place_unless_the_readings_say_otherwise(robot: Robot) -> None:
    """Two patches 10 mm apart whose forces stand for one between them; it presses 2.5 mm beside it."""
    (single,) = robot.device.contacts
    assert isinstance(single, SurfacePatches)
    contact = replace(single, offsets=jnp.array([-5e-3, 5e-3]))
    device = replace(robot.device, contacts=(contact,))
    place = jnp.asarray(facing(np.array([[0.043, SIDE, 0.006]]), (0, -1, 0)))
    np.testing.assert_array_equal(place[0, 1], [1, 0, 0])
    np.testing.assert_allclose(contact.arms, [-5e-3, 5e-3], atol=1e-12)
    true = jnp.array([0.3, 0.1, 0.0, 0.0])
    limits = Limits(
        jnp.zeros(4),
        jnp.array([5.0, 5.0, 0.0, 0.0]),
        jnp.full(4, 1e-9),
        motion=jnp.array(3e-3),
        place=jnp.array(2e-3),
    )
    target = eqx.filter_jit(lambda d: d.reading(simulate(d, place, true).state))(device)

    @eqx.filter_jit
    def found(weight):
        seen = Observation(target, jnp.diag(weight), place)
        state, report = exact_steps(device, limits, device.rest_state(place), seen, steps=STEPS)
        return state.drive, report.misfit

    # The tip's way to the side alone does not say where: then it is the middle, and what the force must be.
    drive, misfit = found(jnp.array([0.0, 1e7, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(drive[0], drive[1], rtol=1e-3)
    assert abs(float(misfit[1])) < 1e-8 and 0.3 < float(drive[:2].sum()) < 0.4
    # What shortens with it tells the arm.
    drive, _ = found(jnp.full(5, 1e9))
    np.testing.assert_allclose(drive, true, rtol=0.02, atol=1e-6)
