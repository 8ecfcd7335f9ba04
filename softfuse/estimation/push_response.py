"""What readings would change by under a newton that one contact presses with anywhere on the surface, at any
state of a robot: its small presses, shared out between its forces by its own law, see `rest_response`.
"""

from dataclasses import replace

import equinox as eqx
import jax
from jaxtyping import Array, Float

from softfuse.estimation.rest_response import Press
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import State


@eqx.filter_jit
def push_response(
    model: Model, places: Float[Array, "s 3 3"], state: State, slot: int = 0
) -> Float[Array, "s k"]:
    """Readings per newton (s, k) [SI/N] of what the contact `slot` is, at places (s, 3, 3), each alone on the
    robot as its actuators hold it in a state.
    """
    loads = Loads(model.actuators)
    sizes = loads.sizes
    own = (
        each[each.shape[0] - count :]
        for each, count in (
            (state.force, sizes.forces),
            (state.internal, sizes.internal),
            (state.drive, sizes.drives),
        )
    )
    held = State(state.z, *own)
    inverse = tangent_at(model.linear, model.body, loads, held)
    alone = replace(model, contacts=(model.kinds(slot + 1)[slot],), slots=())

    def one(place):
        press = Press.at(alone, alone, inverse, place, held)
        return press.felt(press.answer()).by_force

    return jax.lax.map(one, places)
