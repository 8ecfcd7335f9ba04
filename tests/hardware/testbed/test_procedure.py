"""The press as a state machine, against bodies that are springs."""

import math
from dataclasses import replace

import pytest

from softfuse.errors import HardwareError
from softfuse.hardware.testbed.procedure import (
    Feel,
    Hold,
    Move,
    Phase,
    Place,
    PressSettings,
    Rest,
    Seen,
    Tare,
    advance,
    begin,
    give_up,
)

SETTINGS = PressSettings()
HIGH = Place(0.0, 0.0, 0.02)


def press(force, settings=SETTINGS, start=HIGH, most=500):
    """All that is done in a press on a body with force(depth [m]) [N]: (phase, action, force) each."""
    at, done = start, []
    now = begin(settings, 0.01, -0.006, start)
    while now.action is not None:
        assert len(done) < most
        at = now.action.to if isinstance(now.action, Move) else at
        felt = force(max(-at.height, 0.0))
        done.append((now.phase, now.action, felt))
        seen = Seen(at, felt if isinstance(now.action, Feel | Hold) else math.nan)
        now = advance(settings, now, seen)
    assert now.phase is Phase.ENDED
    return now, done


def silicone(depth):
    """Stiffens: 4 N/mm at first, twice that at 3 mm."""
    return 4e3 * depth * (1.0 + depth / 3e-3)


@pytest.mark.parametrize("force", [silicone, lambda d: 4e3 * d, lambda d: 2e4 * d, lambda d: 4e6 * d**1.9])
def test_each_level_is_held_once_and_in_order(force):
    end, done = press(force)
    assert end.trouble is None
    holds = [(action.level, felt) for _, action, felt in done if isinstance(action, Hold)]
    assert [level for level, _ in holds] == [1, 2, 3]
    for (_, felt), level in zip(holds, SETTINGS.levels, strict=True):
        # Not closer than the finest step of the stiffest body allows.
        assert level - SETTINGS.tolerance <= felt <= level + 0.5
    assert max(felt for _, _, felt in done) < SETTINGS.force_limit


def test_the_order_of_what_is_done():
    _, done = press(silicone)
    phases = [phase for phase, _, _ in done]
    assert phases[:4] == [Phase.TRAVEL, Phase.TARE, Phase.APPROACH, Phase.FEEL]
    assert phases[-2:] == [Phase.RETREAT, Phase.REST]
    assert done[0][1] == Move(Place(0.01, -0.006, SETTINGS.clearance), SETTINGS.travel_speed)
    assert done[1][1] == Tare(SETTINGS.tare) and done[-1][1] == Rest(SETTINGS.rest)
    assert done[-2][1] == Move(Place(0.01, -0.006, SETTINGS.clearance), SETTINGS.retreat_speed)
    # A force is felt before every step down.
    assert all(phases[i - 1] is Phase.FEEL for i, phase in enumerate(phases) if phase is Phase.STEP)


def test_it_goes_down_in_small_steps_only():
    _, done = press(silicone)
    heights = [action.to.height for phase, action, _ in done if phase in (Phase.APPROACH, Phase.STEP)]
    steps = [a - b for a, b in zip(heights[:-1], heights[1:], strict=True)]
    assert heights[0] == SETTINGS.approach
    assert all(0.0 < step <= SETTINGS.longest_step * (1 + 1e-9) for step in steps)
    speeds = {action.speed for phase, action, _ in done if phase is Phase.STEP}
    assert speeds == {SETTINGS.press_speed}


def test_a_stage_that_stands_low_is_lifted_before_it_travels():
    _, done = press(silicone, start=Place(0.02, 0.02, -0.001))
    assert done[0][0] is Phase.LIFT and done[0][1].to == Place(0.02, 0.02, SETTINGS.clearance)
    assert done[1][0] is Phase.TRAVEL


def test_without_a_body_it_stops_at_the_depth_limit():
    end, done = press(lambda depth: 0.0)
    assert "0.00 N instead of 5 N at the depth limit of 6 mm" in str(end.trouble)
    heights = [action.to.height for _, action, _ in done if isinstance(action, Move)]
    assert min(heights) == pytest.approx(-SETTINGS.depth_limit, abs=1e-12)
    assert min(heights) >= -SETTINGS.depth_limit - 1e-12
    assert heights[-1] == SETTINGS.clearance and not any(isinstance(a, Hold) for _, a, _ in done)


def test_a_wall_ends_the_press_with_one_step_at_most():
    end, done = press(lambda depth: 2e5 * depth)
    assert "beyond the limit of 20 N" in str(end.trouble)
    assert sum(felt > SETTINGS.force_limit and phase is Phase.STEP for phase, _, felt in done) == 1


@pytest.mark.parametrize(
    ("force", "told"),
    [
        (lambda d: -4e3 * d, "the force's sign is the other one"),
        (lambda d: math.nan, "the force is not known"),
    ],
)
def test_a_force_that_cannot_be_is_no_reason_to_press_harder(force, told):
    end, done = press(force)
    assert told in str(end.trouble)
    assert sum(phase is Phase.STEP for phase, _, _ in done) < 20


def test_giving_up_goes_straight_up_and_never_down():
    now = begin(SETTINGS, 0.01, 0.0, HIGH)
    low = give_up(SETTINGS, now, Place(0.01, 0.0, -0.002), "why")
    assert low.action == Move(Place(0.01, 0.0, SETTINGS.clearance), SETTINGS.retreat_speed)
    high = give_up(SETTINGS, now, HIGH, "why")
    assert high.action is None and high.phase is Phase.ENDED and high.trouble == "why"


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
