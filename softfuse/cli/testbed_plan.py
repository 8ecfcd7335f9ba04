"""What a test bed is going to do, in words."""

from collections.abc import Iterator
from dataclasses import dataclass

from softfuse.hardware.testbed.bench import Origin
from softfuse.hardware.testbed.places import Point
from softfuse.hardware.testbed.procedure import PressSettings


@dataclass(frozen=True)
class Plan:
    """places: that are still to be pressed [m]; wanted: how many there are with those that are done; first:
    the number of the first press; origin: of the body's coordinates in those of the stage [m].
    """

    places: list[Point]
    wanted: int
    first: int
    origin: Origin
    settings: PressSettings


def moves(plan: Plan) -> Iterator[str]:
    """The moves, a line each press, in the stage's coordinates."""
    settings, (x0, y0, z0) = plan.settings, plan.origin
    levels = ", ".join(f"{level:g}" for level in settings.levels)
    yield (
        f"{len(plan.places)} of {plan.wanted} places to press, at {levels} N; never beyond "
        f"{settings.force_limit:g} N nor {1e3 * settings.depth_limit:g} mm deep"
    )
    up, near, down = (
        1e3 * (z0 + height) for height in (settings.clearance, settings.approach, -settings.depth_limit)
    )
    for number, (x, y) in enumerate(plan.places, start=plan.first):
        yield (
            f"press {number} at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm: "
            f"G1 X{1e3 * (x0 + x):.4f} Y{1e3 * (y0 + y):.4f} Z{up:.4f} F{60e3 * settings.travel_speed:.0f}; "
            f"tare; G1 Z{near:.4f} F{60e3 * settings.travel_speed:.0f}; "
            f"down by {1e3 * settings.longest_step:g} mm or less, F{60e3 * settings.press_speed:.0f}, "
            f"to Z{down:.4f} at most; G1 Z{up:.4f} F{60e3 * settings.retreat_speed:.0f}"
        )
