"""A functional g(q): a scalar of the configuration that is a sensor's reading, or an actuator's stroke with a
conjugate force.
"""

from typing import Protocol

from jaxtyping import Array, Float


class Functional(Protocol):
    """Anything that maps node positions (k, 3) m to a scalar in SI units, differentiably."""

    def __call__(self, positions: Float[Array, "k 3"]) -> Float[Array, ""]:
        """The value at node positions (k, 3) m."""
        ...
