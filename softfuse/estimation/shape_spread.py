"""How sure a shape is: as sure as what has moved the body there.

Drives and places of contacts of covariance C, with which the equilibrium moves by J = (dz/du, dz/dp)
(`motion`), leave nodes uncertain by J C Jᵀ. Sensors' noise, the model's error and what is not known of its
parameters are in C, as far as they are in what the readings say of drives and places.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.motion import motion
from softfuse.mechanics.model import Model
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import State


def displacement_sigma(
    device: Model, state: State, places: Array | np.ndarray, covariance: Float[np.ndarray, "m m"]
) -> Float[np.ndarray, "k 3"]:
    """Standard deviations (k, 3) m of the nodes' displacements along x, y and z in a state, under contacts at
    places (c, 3, 3), of a covariance (m, m) of its drives and then, if it is larger, of places along
    their tangents.
    """
    by_place = len(covariance) > len(state.drive)
    moved = np.asarray(_columns(device, state, jnp.asarray(places), by_place))
    variance = np.einsum("mki,mn,nki->ki", moved, covariance, moved)
    return np.sqrt(np.maximum(variance, 0.0))


@eqx.filter_jit
def _columns(device: Model, state: State, places: Array, by_place: bool) -> Float[Array, "m k 3"]:
    """How the nodes move (m, k, 3) with each drive and place."""
    inverse = tangent_at(device.linear, device.body, device.loads(places), state)
    moving = motion(device, inverse, state, places, by_place=by_place, refinements=0)
    return jax.vmap(device.body.displacement, 1)(moving.dz)
