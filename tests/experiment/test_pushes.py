"""Pushes of rigid tips on a virtual finger: what is done, the tips' geometry, a push that is computed."""

import jax.numpy as jnp
import numpy as np
import pytest
from made_robots import FINGER, quick_robot, settings_of

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
from softfuse.experiment.performance import Performance
from softfuse.experiment.timeline import Timing, frames
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot

TIPS = Tips((0.05, 0.02, 0.02), (0.010, 0.040))
RADIUS = TIPS.radius


@pytest.fixture(scope="module")
def finger() -> VirtualRobot:
    return quick_robot(settings_of(FINGER), MakingErrors(nodes=0, stiffness=0.0))


@pytest.fixture(scope="module")
def solver(finger: VirtualRobot) -> PushSolver:
    return PushSolver(finger, TIPS, Steps())


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


def test_one_push_is_computed_and_seen(finger: VirtualRobot, solver: PushSolver) -> None:
    push = Push(((1, "left"),), 0.0, (1e-3,))
    count: list[int] = []
    poses = solver.poses(push, solved=lambda: count.append(1))
    assert len(count) == equilibria(push, Steps()) == 1
    played = Performance(finger, solver.places(push)[None], frames([poses], Timing(rest_s=10.0)))
    columns = {name: values for name, (_, values) in played.recording(1, 1).items()}
    at = int(np.flatnonzero(columns["sample"])[0])
    held = {name: float(values[at]) for name, values in columns.items()}
    assert held["true_depth_mm"] == pytest.approx(1.0)
    assert 0.05 < held["true_hand0_force_N"] < 5.0
    assert held["true_hand1_force_N"] == 0.0 and np.isnan(held["true_hand1_x_mm"])
    # The cable keeps its length, so that a bent finger pulls on it.
    assert held["true_palm_N"] > 0.0 and abs(held["true_palm_mm"]) < 1e-6
    # The tip pushes towards -y: the end follows, the left chamber is stretched, the right one squeezed.
    assert -2.0 < held["true_end_y_mm"] < -0.5
    assert held["true_left_Pa"] < 0 < held["true_right_Pa"]
    assert held["true_hand0_x_mm"] == pytest.approx(40.0) and held["true_hand0_place"] == 1
    assert held["electrode1"] - columns["electrode1"][:900].mean() > 1000
    assert abs(held["electrode0"] - columns["electrode0"][:900].mean()) < 200
    rise = held["pressure1_V"] - columns["pressure1_V"][:900].mean()
    assert rise == pytest.approx(5 * 0.009e-3 * held["true_right_Pa"], abs=6e-3)


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
    np.testing.assert_allclose(turned.centre, turn @ np.asarray(same.centre) + 0.01, atol=1e-12)
    np.testing.assert_allclose(turned.direction, turn @ [0.0, -1.0, 0.0], atol=1e-12)
    assert abs(np.asarray(turned.axis) @ turn @ [0.0, 0.0, 1.0]) == pytest.approx(1.0)
    # A bump on the middle line is met before the rest.
    bumpy = rest.copy()
    bumpy[19, 1] += 1e-3
    _, first = set_against(tip, bumpy.reshape(grid))
    assert first == pytest.approx(-1e-3, rel=0.1)


def test_a_tip_that_left_the_finger_behind_is_seen(finger: VirtualRobot) -> None:
    body = finger.made.parts.body
    tip = TIPS.before(body, 1, "left")
    rest = patch_of(tip, body, jnp.zeros(body.n))
    # With the finger where it rests the tip is before it, touches it, and is beyond its skin.
    assert not passed_through(tip, -0.03, rest)
    assert not passed_through(tip, 0.0, rest)
    assert passed_through(tip, 2.5 * RADIUS, rest)


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
def test_a_push_that_is_none_is_told(solver: PushSolver, push: Push, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        solver.poses(push)


def test_tips_that_meet_the_finger_at_a_line_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least"):
        Tips((0.05, 0.02, 0.02), (0.01,), points=(1, 3))
