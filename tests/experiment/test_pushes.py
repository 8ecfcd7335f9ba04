"""Pushes on a finger by rigid round tips: levels, tips set against its side, and one push as computed."""

import jax.numpy as jnp
import numpy as np
import pytest
from made_robots import quick_robot, settings_of

from softfuse.errors import ConfigError
from softfuse.experiment.paper.pushes import (
    CABLE_ALONE,
    TABLE_III,
    TWO_CONTACTS,
    Push,
    PushSolver,
    Steps,
    cable_levels,
    depth_levels,
    equilibria,
)
from softfuse.experiment.paper.tips import Tips, passed_through, patch_of, set_against
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot

RADIUS = 5e-3
TIPS = Tips((0.05, 0.02, 0.02), (0.010, 0.040))
NONE = MakingErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, skin=0.0, nodes=0)
SHORT = """
[robot]
name = "Short finger"

[body.source]
type = "finger"
size = ["50 mm", "20 mm", "20 mm"]
neck_x = ["25 mm"]
neck_length = "12 mm"
neck_height = "15 mm"
cavity_size = ["8 mm", "6 mm", "10 mm"]
wall_size = "1 m"
base_size = "30 mm"
growth = 0.0

[[body.material]]
law = "neo-hookean"
young = "0.6 MPa"
poisson = 0.49

[body.fixed]
x = ["0 mm", "0 mm"]

[[chamber]]
name = "left"
centre = ["25 mm", "5 mm", "12.5 mm"]
gas = "sealed"
dead_volume = "100 mm^3"

[[chamber]]
name = "right"
centre = ["25 mm", "-5 mm", "12.5 mm"]
gas = "sealed"
dead_volume = "100 mm^3"

[[cable]]
name = "palm"
guides = [
    ["5 mm", "0 mm", "3 mm"], ["15 mm", "0 mm", "3 mm"], ["35 mm", "0 mm", "3 mm"], ["45 mm", "0 mm", "3 mm"],
]
pulled_at = ["-5 mm", "0 mm", "3 mm"]
anchor_radius = "3 mm"
max_tension = "20 N"

[[contact]]
name = "hand"
model = "patch"
radius = "4 mm"
max_force = "5 N"
at_once = 2

[[point]]
name = "tip"
at = ["47 mm", "0 mm", "10 mm"]

[[sensor]]
name = "pressure"
type = "pressure"
part = "MPX5100A"
chambers = ["left", "right"]
channels = ["p0", "p1"]

[[sensor]]
name = "electrodes"
type = "electrodes"
contact = "hand"
channels = ["e0", "e1"]
electrodes = [
    { name = "lower left", centre = ["10 mm", "10 mm", "10 mm"], direction = [0, -1, 0] },
    { name = "tip left", centre = ["40 mm", "10 mm", "10 mm"], direction = [0, -1, 0] },
]
"""
"""One neck, on the coarsest mesh."""


@pytest.fixture(scope="module")
def finger() -> VirtualRobot:
    return quick_robot(settings_of(SHORT), NONE)


def test_levels_hold_what_is_sampled_and_step_no_further() -> None:
    push = Push(((3, "left"),), 10e-3, (5e-3, 10e-3, 11e-3))
    np.testing.assert_allclose(cable_levels(push, Steps()), 1e-3 * np.array([0, 2.5, 5, 7.5, 10]))
    np.testing.assert_allclose(depth_levels(push, Steps()), 1e-3 * np.array([0, 2.5, 5, 7.5, 10, 11]))
    assert set(push.depths) <= set(depth_levels(push, Steps()).tolist())
    assert equilibria(push, Steps()) == 9
    assert equilibria(Push(cable=10e-3), Steps(cable=3e-3)) == 4


def test_the_scenarios_are_those_of_the_paper_and_its_neighbours() -> None:
    assert {(push.contacts[0], push.cable) for push in TABLE_III} == {
        ((segment, "left"), cable) for segment in (3, 2) for cable in (0.0, 0.01)
    }
    assert all(push.depths == (5e-3, 10e-3, 15e-3, 20e-3) for push in TABLE_III)
    assert all(len({segment for segment, _ in push.contacts}) == 2 for push in TWO_CONTACTS)
    assert all(not push.contacts and push.cable > 0 for push in CABLE_ALONE)


def test_one_push_is_computed(finger: VirtualRobot) -> None:
    push, count = Push(((1, "left"),), 0.0, (1e-3,)), list[int]()
    solver = PushSolver(finger, TIPS, Steps())
    poses = solver.poses(push, solved=lambda: count.append(1))
    assert len(count) == equilibria(push, Steps()) == 1
    (held,) = np.flatnonzero(poses["held"])
    assert held == len(poses["held"]) - 1
    assert 0.05 < poses["force"][held, 0] < 5.0 and poses["force"][held, 1] == 0.0
    assert not poses["force"][:held].any()
    # The cable keeps its length, so that a bent finger pulls on it.
    assert poses["answer"][held, 0] == pytest.approx(0.0, abs=1e-9) and poses["drive"][held, 0] > 0.0
    # The tip pushes towards -y: the end follows, the left chamber is stretched, the right one squeezed.
    assert -2.0e-3 < poses["point"][held, 0, 1] < -0.5e-3
    left, right = poses["volume"][held]
    assert right < 0 < left
    gauge = poses["reading"][held, :2]
    assert gauge[0] < 0 < gauge[1]
    np.testing.assert_allclose(gauge, 101325.0 * (580e-9 / (580e-9 + poses["volume"][held]) - 1), rtol=1e-6)
    # Its electrode sees it, the other one does not.
    seen = poses["signal electrodes"]
    assert seen[held, 1] > 0.3 > 0.02 > seen[held, 0] and seen[0].max() < 1e-3
    np.testing.assert_allclose(solver.places(push)[0], [0.04, 0.01, 0.01], atol=1e-15)
    assert np.isnan(solver.places(push)[1]).all()


def test_a_tip_is_set_against_the_side_as_it_lies(finger: VirtualRobot) -> None:
    body = finger.made.parts.body
    tip = TIPS.before(body, 1, "left")
    rest = patch_of(tip, body, jnp.zeros(body.n))
    grid = (*TIPS.points, 3)
    same, first = set_against(tip, rest.reshape(grid))
    np.testing.assert_allclose(same.centre, [0.04, 0.01 + RADIUS, 0.01], atol=1e-12)
    np.testing.assert_allclose(same.direction, [0.0, -1.0, 0.0], atol=1e-12)
    assert first == pytest.approx(0.0, abs=1e-12)
    turn = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    turned, first = set_against(tip, (rest @ turn.T + 0.01).reshape(grid))
    assert first == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(turned.direction, turn @ [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turned.centre, turn @ [0.04, 0.01 + RADIUS, 0.01] + 0.01, atol=1e-12)
    assert abs(np.asarray(turned.axis) @ turn @ [0.0, 0.0, 1.0]) == pytest.approx(1.0)
    # A bump on the middle line is met before the rest.
    bumpy = rest.copy()
    bumpy[19, 1] += 1e-3
    _, first = set_against(tip, bumpy.reshape(grid))
    assert first == pytest.approx(-1e-3, rel=0.1)


def test_a_tip_that_left_the_finger_behind_is_seen(finger: VirtualRobot) -> None:
    body = finger.made.parts.body
    tip = TIPS.before(body, 1, "left")
    patch = patch_of(tip, body, jnp.zeros(body.n))
    # With the finger where it rests the tip is before it, touches it, and is beyond its skin.
    assert not passed_through(tip, -0.03, patch)
    assert not passed_through(tip, 0.0, patch)
    assert passed_through(tip, 2.5 * RADIUS, patch)


@pytest.mark.parametrize(
    ("push", "words"),
    [
        (Push(((0, "left"),)), "0 depths"),
        (Push(depths=(1e-3,)), "1 depths"),
        (Push(((0, "left"), (0, "left")), 0.0, (1e-3,)), "two tips at one place"),
        (Push(((0, "left"), (0, "palm"), (0, "right")), 0.0, (1e-3,)), "at most 2"),
        (Push(((0, "left"),), 0.0, (2e-3, 1e-3)), "increase"),
        (Push(((0, "left"),), -1e-3, (1e-3,)), "must not be negative"),
        (Push(((2, "left"),), 0.0, (1e-3,)), "segment 2 cannot be pushed"),
    ],
)
def test_a_push_that_is_none_is_told(finger: VirtualRobot, push: Push, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        PushSolver(finger, TIPS, Steps()).poses(push)
