"""A finger that bends far, on a chart of few points."""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import Body
from softfuse.mechanics.model import simulate
from softfuse.mechanics.solution import RESULTS
from softfuse.robot.file import load
from softfuse.robot.reduced import Teacher, build_regions
from softfuse.robot.robot import build_robot
from softfuse.rom.basis import rest_stiffness
from softfuse.rom.reduced_model import reduced_model

CHANGES = (
    ("sampling = 0.0001 ", "sampling = 0.0005\nlevels = 2\nnear = 4 "),
    ('travel = "50 mm"', 'travel = "30 mm"'),
    ('tension = "4 N"', 'tension = "3 N"'),
)
NUMBER = 7
ELECTRODES = ("base left", "upper left", "tip left")


@pytest.mark.slow
def test_what_was_not_taught_is_that_of_the_full_finger(linear_finger: Callable[..., Path]) -> None:
    """Pushes beside each other while the cable pulls: the shape to 0.3 % of the furthest way of a node."""
    robot = build_robot(load(linear_finger(*CHANGES)))
    model, regions = robot.model, build_regions(robot.settings)
    places = np.array(list(robot.settings.places.values()))
    assert isinstance(model.body, Body) and len(regions) == len(places)
    stiffness = rest_stiffness(model.body)
    teacher = Teacher(robot, stiffness, regions)
    assert teacher.largest_force(NUMBER) >= 1.0
    chart = teacher.chart(NUMBER)
    assert not chart.sampling.beyond_rest and len(chart.sampling.cubature.parts) < model.body.volumes.size / 2
    small, place = reduced_model(model, stiffness, chart, places), jnp.asarray(places[NUMBER])[None]
    for push, pull in ((1.0, 1.3), (0.4, 2.6)):
        drive = model.rest_state(place).drive.at[:3].set(jnp.array([0.7 * push, 0.3 * push, pull]))
        exact, found = (jax.block_until_ready(simulate(each, place, drive)) for each in (model, small))
        assert exact.result == found.result == RESULTS.converged
        shape, nearly = (each.body.displacement(at.state.z) for each, at in ((model, exact), (small, found)))
        way = float(jnp.max(jnp.linalg.norm(shape, axis=1)))
        assert way > 5e-3
        assert float(jnp.max(jnp.linalg.norm(nearly - shape, axis=1))) < 3e-3 * way
        *pressures, cable = np.asarray(model.reading(exact.state))
        *nearly_pressures, nearly_cable = np.asarray(small.reading(found.state))
        assert abs(nearly_cable - cable) < 0.02 * abs(cable)
        np.testing.assert_allclose(nearly_pressures, pressures, atol=0.05 * np.ptp(pressures))


@pytest.mark.slow
def test_charts_are_good_for_pushes_that_move_the_finger_so_far(linear_finger: Callable[..., Path]) -> None:
    robot = build_robot(load(linear_finger(('travel = "50 mm"', 'travel = "1 mm"'))))
    model, places = robot.model, robot.settings.places
    assert isinstance(model.body, Body)
    teacher = Teacher(robot, rest_stiffness(model.body), build_regions(robot.settings))
    numbers = [list(places).index(name) for name in ELECTRODES]
    base, middle, tip = map(teacher.largest_force, numbers)
    assert 0 < tip < middle < base <= robot.settings.contact().max_force
    place = jnp.asarray(places[ELECTRODES[-1]])[None]
    drive = model.rest_state(place).drive.at[:2].set(tip / 2)
    moved = model.body.displacement(simulate(model, place, drive).state.z)
    assert 1e3 * float(jnp.max(jnp.linalg.norm(moved, axis=1))) == pytest.approx(1.0, rel=0.01)
