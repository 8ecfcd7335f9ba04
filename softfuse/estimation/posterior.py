"""How sure an estimate is of its drives and of the places that it moved, and so of its shape.

Drives and places of contacts of covariance C, with which the equilibrium moves by J = (dz/du, dz/dp)
(`motion`), leave nodes uncertain by J C Jᵀ. Sensors' noise, the model's error and what is not known of its
parameters are in C, as far as they are in what the readings say of drives and places.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.estimator import Estimate
from softfuse.estimation.limits import Limits
from softfuse.estimation.motion import motion
from softfuse.mechanics.model import Model
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import State


def posterior_covariance(found: Estimate, limits: Limits) -> Float[np.ndarray, "DP DP"]:
    """Covariance (D + P, D + P) of the drives of an estimate and of the numbers η of places that were not
    known, of those within their limits the inverse of their information.

    A drive that is held at a limit has the variance that it would have alone, if it could move: by so much
    the readings let it be wrong; one that has no room has none.
    """
    lower, upper = np.asarray(limits.lower), np.asarray(limits.upper)
    information, room = found.report.information, 1e-9 * (upper - lower)
    places = np.ones(len(information) - len(upper), bool)
    movable = upper > lower
    within = movable & (found.drive > lower + room) & (found.drive < upper - room)
    free = np.append(within, places)
    alone = np.where(np.append(movable & ~within, ~places), 1 / np.diag(information), 0.0)
    covariance = np.diag(alone)
    covariance[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
    return covariance


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
