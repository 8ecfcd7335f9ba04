"""A functional g(q): a scalar of the configuration that is a sensor's reading, or an actuator's stroke with a
conjugate force.
"""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody


class AbstractFunctional(eqx.Module):
    """Anything that can say by how much it differs from its value on a body at rest, in SI units; or some
    such numbers that are found together.
    """

    @property
    def count(self) -> int:
        """How many numbers."""
        return 1

    @abstractmethod
    def change(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, "..."]:
        """g(z) − g(0), a number or (count,), at unknowns z (n,) of a body, differentiably."""


class Functional(AbstractFunctional):
    """A functional of the node positions, whatever unknowns they come from."""

    @abstractmethod
    def __call__(self, positions: Float[Array, "k 3"]) -> Float[Array, ""]:
        """The value at node positions (k, 3) m, differentiably."""

    def change(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, ""]:
        """g(z) − g(0) at unknowns z (n,) of a body that watches the functional's nodes."""
        return self(body.rest + body.watched(z)) - self(body.rest)
