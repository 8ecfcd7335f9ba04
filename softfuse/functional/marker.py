"""A material point's position along a direction: g = d · x(X), for optical tracking; its conjugate force is a
point force [N].
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from softfuse.functional.base import Functional


class Marker(Functional):
    """A point carried by nodes (a,) with shape-function values `shape` (a,), read along the unit vector
    `direction` (3,).
    """

    nodes: Int[Array, " a"]
    shape: Float[Array, " a"]
    direction: Float[Array, "3"]

    def __call__(self, positions: Float[Array, "k 3"]) -> Float[Array, ""]:
        """Position [m] along the direction, at node positions (k, 3) m."""
        return jnp.dot(self.direction, self.shape @ positions[self.nodes])
