"""Where a stage may go, and how fast: checked before anything is sent."""

import math
from dataclasses import dataclass

from softfuse.errors import HardwareError

Place = tuple[float, float, float]
"""x, y, z [m], in the stage's coordinates."""
_AXES = "xyz"

TOLERANCE = 0.02e-3
"""How far from its target a stage may stop [m]; firmwares round to a step."""


@dataclass(frozen=True)
class Workspace:
    """A box and a greatest speed; HardwareError where they are none.

    A straight move between two points of the box stays in it; one from outside, after homing, comes in. A
    stage that stands at the box's edge, as exactly as stages do, may retreat along it.
    """

    lowest: Place
    highest: Place
    fastest: float
    """[m/s]"""

    def __post_init__(self) -> None:
        for axis, low, high in zip(_AXES, self.lowest, self.highest, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise HardwareError(
                    f"the stage's {axis} cannot lie between {_mm(low)} and {_mm(high)}: "
                    "give the lowest first, then the highest"
                )
        if not (math.isfinite(self.fastest) and self.fastest > 0.0):
            raise HardwareError(f"the stage's greatest speed cannot be {_mm(self.fastest)}/s")

    def check(self, place: Place, speed: float) -> None:
        """HardwareError unless the stage may go to the place [m] with the speed [m/s]."""
        for axis, value, low, high in zip(_AXES, place, self.lowest, self.highest, strict=True):
            if not low - TOLERANCE <= value <= high + TOLERANCE:
                raise HardwareError(
                    f"the stage must not go to {axis} = {_mm(value)}: {axis} lies between {_mm(low)} and "
                    f"{_mm(high)}; nothing has moved"
                )
        if not 0.0 < speed <= self.fastest:
            raise HardwareError(
                f"the stage must not go with {_mm(speed)}/s: up to {_mm(self.fastest)}/s; nothing has moved"
            )


def _mm(length: float) -> str:
    return f"{1e3 * length:g} mm"
