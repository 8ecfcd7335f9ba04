"""How sure an estimate is of drives, places and shape, and what sensors can tell before anything is measured.

Drives and places of contacts of covariance C, with which the equilibrium moves by J = (dz/du, dz/dp)
(`motion`), leave nodes uncertain by J C Jᵀ. Sensors' noise, the model's error and what is not known of its
parameters are in C, as far as they are in what the readings say of drives and places.

A press with force F at a place p changes readings of covariance S = L Lᵀ by the slopes w = ∂s/∂F (k,) and G =
∂s/∂p (k, 2), p along the surface's two tangents. With A = L⁻¹ [w, G] and what else knows the place, to σ_p,

    covariance of (F, p) = (AᵀA + diag(0, σ_p⁻², σ_p⁻²))⁻¹;

the singular values of A, per newton and per millimetre, say how many directions of (F, p) the readings tell
and how well.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import SolveError
from softfuse.estimation.batch import side_by_side
from softfuse.estimation.estimator import Estimate
from softfuse.estimation.limits import Limits
from softfuse.estimation.motion import motion
from softfuse.functional.chart import moved
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import RESULTS, State

_PER = np.array([1.0, 1e3, 1e3])
"""Force in N, places in mm."""


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
    model: Model, state: State, places: Array | np.ndarray, covariance: Float[np.ndarray, "m m"]
) -> Float[np.ndarray, "k 3"]:
    """Standard deviations (k, 3) m of the nodes' displacements along x, y and z in a state, under contacts at
    places (c, 3, 3), of a covariance (m, m) of its drives and then, if larger, of places along tangents.
    """
    by_place = len(covariance) > len(state.drive)
    moved = np.asarray(_columns(model, state, jnp.asarray(places), by_place))
    variance = np.einsum("mki,mn,nki->ki", moved, covariance, moved)
    return np.sqrt(np.maximum(variance, 0.0))


@eqx.filter_jit
def _columns(model: Model, state: State, places: Array, by_place: bool) -> Float[Array, "m k 3"]:
    """How the nodes move (m, k, 3) with each drive and place."""
    inverse = tangent_at(model.linear, model.body, model.loads(places), state)
    moving = motion(model, inverse, state, places, by_place=by_place, refinements=0)
    return jax.vmap(model.body.displacement, 1)(moving.dz)


@dataclass(frozen=True, eq=False)
class Response:
    """How a robot answers to s presses, one at a time: readings (s, k) in SI, `by_force` (s, k) [1/N], and
    `by_place` (s, k, 2) [1/m] along the tangents of the surface.
    """

    reading: Float[np.ndarray, "s k"]
    by_force: Float[np.ndarray, "s k"]
    by_place: Float[np.ndarray, "s k 2"]


@dataclass(frozen=True, eq=False)
class Observability:
    """What readings tell of s presses: `singular` (s, 3) of A, the largest first, per N and per mm.

    `force_sigma_N` (s,), `place_sigma_m` (s, 2): of force and place, with what else knows the place;
    `blind_force_sigma_N`, `blind_place_sigma_m`: without, inf where readings do not tell all three.
    """

    singular: Float[np.ndarray, "s 3"]
    force_sigma_N: Float[np.ndarray, " s"]
    place_sigma_m: Float[np.ndarray, "s 2"]
    blind_force_sigma_N: Float[np.ndarray, " s"]
    blind_place_sigma_m: Float[np.ndarray, "s 2"]


def response(
    model: Model,
    places: Float[np.ndarray, "s 3 3"],
    force_N: float,
    *,
    seen: Callable[[], None] = lambda: None,
) -> Response:
    """The response to one contact at places (s, 3, 3) with a force [N], in equal parts on what it presses
    with; `seen` is called after each.

    Raises SolveError when a press has no equilibrium.
    """
    (kind,) = model.kinds(1)
    others = np.asarray(model.rest_state(jnp.asarray(places[:1])).drive)[kind.drives :]

    def one(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        drive = np.concatenate([force_N * kind.shares, others])
        (by_place, by_drive), (reading, result) = _slopes(model, place, drive)
        if not bool(result == RESULTS.converged):
            at = ", ".join(f"{1e3 * x:.1f}" for x in place[0])
            raise SolveError(f"no equilibrium at {force_N:g} N on ({at}) mm: {RESULTS[result]}")
        seen()
        by_force = np.asarray(by_drive)[:, : kind.drives] @ kind.shares
        return np.asarray(reading), by_force, np.asarray(by_place)

    return Response(*side_by_side(one, places))


@eqx.filter_jit
def _slopes(model: Model, place: Any, drive: Any) -> Any:
    def read(offset, drive):
        at = moved(jnp.asarray(place), offset)[None]
        solution = simulate(model, at, drive)
        reading = model.reading(solution.state, at)
        return reading, (reading, solution.result)

    return jax.jacrev(read, argnums=(0, 1), has_aux=True)(jnp.zeros(2), jnp.asarray(drive))


def observability(
    answer: Response, covariance: Float[np.ndarray, "s k k"], place_sigma_m: float
) -> Observability:
    """What readings of covariances (s, k, k) tell of presses; else places are known to `place_sigma_m`."""
    slopes = np.concatenate([answer.by_force[..., None], answer.by_place], axis=2)
    a = np.linalg.solve(np.linalg.cholesky(covariance), slopes)
    singular = np.zeros((len(a), 3))
    least = min(a.shape[1:])
    singular[:, :least] = np.linalg.svd(a / _PER, compute_uv=False)
    information = np.swapaxes(a, 1, 2) @ a
    known = np.diag([0.0, place_sigma_m**-2, place_sigma_m**-2])
    sigma = np.sqrt(np.diagonal(np.linalg.inv(information + known), axis1=1, axis2=2))
    blind = np.full_like(sigma, np.inf)
    whole = singular[:, 2] > 1e-9 * singular[:, 0]
    blind[whole] = np.sqrt(np.diagonal(np.linalg.inv(information[whole]), axis1=1, axis2=2))
    return Observability(singular, sigma[:, 0], sigma[:, 1:], blind[:, 0], blind[:, 1:])
