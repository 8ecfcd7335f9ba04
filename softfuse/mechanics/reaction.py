"""Force and moment with which a body is held, as a six-axis sensor under its base feels them.

The body is in balance as a whole, in its current shape: what holds it is minus the resultant of gravity and
of all its loads, which is each port's force times ∂y/∂(motion) for rigid motions of the whole body. No stress
is needed, so that a reduced body tells it as well as a full one.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State


class Reaction(eqx.Module):
    """Force [N] and moment [Nm] from the support on the body, about `origin` (3,) m, in a frame whose axes
    are the columns of `rotation` (3, 3). `internal`: numbers of loads whose other end is on the same side of
    the sensor as the body, such as cables with their motor: these cancel.
    """

    origin: Float[Array, "3"]
    rotation: Float[Array, "3 3"]
    internal: tuple[int, ...] = eqx.field(static=True, default=())

    def value(self, body: AbstractBody, loads: Loads, state: State) -> Float[Array, "6"]:
        """Force [N], then moment [Nm] (6,), at a state in which the body is in balance."""
        total, first = body.weight_resultant(state.z), 0
        for number, part in enumerate(loads.parts):
            count = part.sizes.forces
            if number not in self.internal:
                each = part.ports.resultants(body, state.z)[:, :count]
                total = total + each @ state.force[first : first + count]
            first += count
        force, moment = total[:3], total[3:] - jnp.cross(self.origin, total[:3])
        return -jnp.concatenate([self.rotation.T @ force, self.rotation.T @ moment])
