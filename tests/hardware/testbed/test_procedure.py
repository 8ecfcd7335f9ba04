"""The press, against bodies that are springs."""

import math
from dataclasses import replace

import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.testbed.procedure import (
    Feel,
    Hold,
    Move,
    Place,
    PressSettings,
    Rest,
    Seen,
    Tare,
    press,
)

SETTINGS = PressSettings()
HIGH = Place(0.0, 0.0, 0.02)


def pressed(force, settings=SETTINGS, start=HIGH, most=500):
    """All that is done in a press on a body with force(depth [m]) [N], (action, force) each; and why it was
    given up, "" where it was not.
    """
    height, done = start.height, []
    actions = press(settings, 0.01, -0.006, start)
    try:
        action = next(actions)
        while True:
            assert len(done) < most
            height = action.to.height if isinstance(action, Move) else height
            felt = force(max(-height, 0.0))
            done.append((action, felt))
            action = actions.send(Seen(height, felt if isinstance(action, Feel | Hold) else math.nan))
    except StopIteration:
        return done, ""
    except HardwareError as error:
        return done, str(error)


def is_step(action):
    """Whether it is a move down while it presses, which alone has this speed."""
    return isinstance(action, Move) and action.speed == SETTINGS.press_speed


def silicone(depth):
    """Stiffens: 4 N/mm at first, twice that at 3 mm."""
    return 4e3 * depth * (1.0 + depth / 3e-3)


@pytest.mark.parametrize("force", [silicone, lambda d: 4e3 * d, lambda d: 2e4 * d, lambda d: 4e6 * d**1.9])
def test_each_level_is_held_once_and_in_order(force):
    done, trouble = pressed(force)
    assert not trouble
    holds = [(action.level, felt) for action, felt in done if isinstance(action, Hold)]
    assert [level for level, _ in holds] == [1, 2, 3]
    for (_, felt), level in zip(holds, SETTINGS.levels, strict=True):
        # Not closer than the finest step of the stiffest body allows.
        assert level - SETTINGS.tolerance <= felt <= level + 0.5
    assert max(felt for _, felt in done) < SETTINGS.force_limit


def test_the_order_of_what_is_done():
    done, _ = pressed(silicone)
    actions = [action for action, _ in done]
    over = Place(0.01, -0.006, SETTINGS.clearance)
    assert actions[:4] == [
        Move(over, SETTINGS.travel_speed),
        Tare(SETTINGS.tare),
        Move(replace(over, height=SETTINGS.approach), SETTINGS.travel_speed),
        Feel(SETTINGS.settle),
    ]
    assert actions[-2:] == [Move(over, SETTINGS.retreat_speed), Rest(SETTINGS.rest)]
    # A force is felt before every step down.
    assert all(isinstance(actions[i - 1], Feel) for i, action in enumerate(actions) if is_step(action))


def test_it_goes_down_in_small_steps_only():
    done, _ = pressed(silicone)
    steps = [action.to.height for action, _ in done if is_step(action)]
    heights = [done[2][0].to.height, *steps]
    assert heights[0] == SETTINGS.approach
    assert all(
        0.0 < a - b <= SETTINGS.longest_step * (1 + 1e-9) for a, b in zip(heights, steps, strict=False)
    )


def test_a_stage_that_stands_low_is_lifted_before_it_travels():
    done, _ = pressed(silicone, start=Place(0.02, 0.02, -0.001))
    assert done[0][0] == Move(Place(0.02, 0.02, SETTINGS.clearance), SETTINGS.retreat_speed)
    assert done[1][0] == Move(Place(0.01, -0.006, SETTINGS.clearance), SETTINGS.travel_speed)


def test_without_a_body_it_stops_at_the_depth_limit():
    done, trouble = pressed(lambda depth: 0.0)
    assert "0.00 N instead of 5 N at the depth limit of 6 mm" in trouble
    heights = [action.to.height for action, _ in done if isinstance(action, Move)]
    assert min(heights) == pytest.approx(-SETTINGS.depth_limit, abs=1e-12)
    assert min(heights) >= -SETTINGS.depth_limit - 1e-12
    assert not any(isinstance(action, Hold) for action, _ in done)


def test_a_wall_ends_the_press_with_one_step_at_most():
    done, trouble = pressed(lambda depth: 2e5 * depth)
    assert "beyond the limit of 20 N" in trouble
    assert sum(felt > SETTINGS.force_limit and is_step(action) for action, felt in done) == 1


@pytest.mark.parametrize(
    ("force", "told"),
    [
        (lambda d: -4e3 * d, "the force's sign is the other one"),
        (lambda d: math.nan, "the force is not known"),
    ],
)
def test_a_force_that_cannot_be_is_no_reason_to_press_harder(force, told):
    done, trouble = pressed(force)
    assert told in trouble
    assert sum(is_step(action) for action, _ in done) < 20


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"levels": ()}, "ascend"),
        ({"levels": (5.0, 5.0)}, "ascend"),
        ({"levels": (0.0, 5.0)}, "above 0"),
        ({"levels": (5.0, math.nan)}, "force levels"),
        ({"longest_step": 0.0}, "longest step"),
        ({"force_limit": 15.0}, "must be above the highest level"),
        ({"depth_limit": math.nan}, "depth limit"),
        ({"press_speed": -1.0}, "press speed"),
        ({"finest_step": 1e-3}, "finest step"),
        ({"tolerance": 6.0}, "tolerance"),
        ({"approach": 6e-3}, "clearance"),
    ],
)
def test_settings_that_cannot_be_are_told(change, told):
    with pytest.raises(HardwareError, match=told):
        replace(SETTINGS, **change)
