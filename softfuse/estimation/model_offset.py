"""What the model misses while nothing is near: learned then, and taken off the readings of a touch.

A body that is not quite its model answers its cables with other readings. While nothing is near, the
difference b is seen with no contact's force in it. It grows with the cables' strokes c, so that later

    b = b₀ |c| / |c₀|,

0 marking the last frame with nothing near. It also holds what the sensors' zeros are off.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

_LARGEST_RATIO = 2.0
"""Beyond so many times the strokes that it was learned at, the offset is not extrapolated [-]."""
_LEAST_STROKE_M = 1e-5
"""Strokes of a smaller norm are none: what is left of them is rounding."""


@dataclass(frozen=True, eq=False)
class ModelOffset:
    """The offset b₀ (k,) of the readings, in their units, learned at strokes of norm |c₀| [m]."""

    reading: Float[np.ndarray, " k"]
    stroke: float

    @classmethod
    def none(cls, readings: int) -> "ModelOffset":
        """Nothing has been learned of so many readings."""
        return cls(np.zeros(readings), 0.0)

    def at(self, stroke: float) -> Float[np.ndarray, " k"]:
        """b (k,) at strokes of a norm in m; b₀ where nothing was pulled when it was learned."""
        ratio = stroke / self.stroke if self.stroke > _LEAST_STROKE_M else 1.0
        return self.reading * min(ratio, _LARGEST_RATIO)

    def learned(
        self, misfit: Float[np.ndarray, " k"], known: Bool[np.ndarray, " k"], stroke: float, share: float
    ) -> "ModelOffset":
        """With a share [-] of measured minus modelled readings (k,) in it; those not known keep theirs."""
        before = self.at(stroke)
        return ModelOffset(np.where(known, before + share * (misfit - before), before), stroke)
