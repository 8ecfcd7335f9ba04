"""A functional g(q): a number or a few of the configuration, which are a sensor's reading or what an
actuator's force does work on.
"""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
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


class MaterialFunctional(AbstractFunctional):
    """A functional of material points: it depends on where nodes are at rest, and on how they have moved."""

    @abstractmethod
    def __call__(self, rest: Float[Array, "k 3"], displacement: Float[Array, "k 3"]) -> Float[Array, " c"]:
        """The values (count,) when nodes at `rest` (k, 3) m have moved by (k, 3) m, differentiably."""

    def value(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, " c"]:
        """g(z) (count,) at unknowns z (n,) of a body that watches the functional's nodes."""
        return self(body.rest, body.watched(z))

    def change(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, " c"]:
        """g(z) − g(0) (count,) at unknowns z (n,) of a body that watches the functional's nodes."""
        return self.value(body, z) - self(body.rest, jnp.zeros_like(body.rest))
