"""What presses on the body, and where and how hard it may."""

from typing import Literal

from pydantic import field_validator

from softfuse.config.quantity import Number, PositiveForce, PositiveLength, wrong_value
from softfuse.config.settings import Range, Settings


class Workspace(Settings):
    """Where the centre of a contact may be: ranges of x and y in m."""

    x: Range
    y: Range


class ContactSettings(Settings):
    """A disc of radius m that pushes along direction (3,) with at most max_force N.

    model: "punch", a rigid flat indenter, or "uniform", the same pressure everywhere under the disc.
    """

    model: Literal["punch", "uniform"]
    radius: PositiveLength
    direction: tuple[Number, Number, Number]
    max_force: PositiveForce
    workspace: Workspace

    @field_validator("direction")
    @classmethod
    def _check_direction(cls, direction: tuple[float, float, float]) -> tuple[float, float, float]:
        if direction == (0.0, 0.0, 0.0):
            raise wrong_value("the direction has no length; use [0, 0, -1] for downwards")
        return direction
