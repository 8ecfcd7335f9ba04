"""What readings would change by under a newton pushed anywhere on the surface, at any state of a robot.

A small force f (n,) on the body moves it by K⁻¹ f and lets the actuators answer, which is linear: ds = A f.
A = (K⁻¹ Tᵀ)ᵀ with T (k, n) the readings' change by such a motion, so that k solves, one for each reading, do
for any number of places: an adjoint. The push of one place is that of a uniform patch along the surface's
current normal there.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from softfuse.body.base import AbstractBody
from softfuse.functional.chart import direction_of
from softfuse.functional.contact import ContactSurface
from softfuse.functional.face_search import EveryFace
from softfuse.functional.pressure_cells import uniform
from softfuse.mechanics.interface import slopes
from softfuse.mechanics.linear_solver import Solve
from softfuse.mechanics.linearised import coupled, linearise, stiffness_map
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model
from softfuse.mechanics.newton import tangent_at
from softfuse.mechanics.solution import State

_RINGS, _ANGLES = 2, 6
"""Points of a patch across and around."""


class Patches(NamedTuple):
    """s patches: the nodes (s, m) under them, with the part (s, m) [-] of the push that each carries, and the
    slopes (s, m, 2) [1/m] of the mean tangents.
    """

    nodes: Int[Array, "s m"]
    part: Float[Array, "s m"]
    slope: Float[Array, "s m 2"]


@eqx.filter_jit
def patches_at(
    body: AbstractBody, faces: Int[Array, "f c"], places: Float[Array, "s 3 3"], radius: float
) -> Patches:
    """Patches of a radius [m] at places (s, 3, 3) of the outward faces (f, c) of a body."""
    cells = uniform(rings=_RINGS, angles=_ANGLES)

    def one(place):
        surface = ContactSurface(faces, direction_of(place), place[:0:-1], EveryFace(len(faces)))
        on = surface.land(body.rest, place[0] + radius * cells.points @ place[1:])
        share = jnp.where(on.met, cells.share, 0.0)
        share = share / jnp.maximum(jnp.sum(share), jnp.finfo(float).tiny)
        each = share[:, None] * on.shape, share[:, None, None] * on.slopes
        return Patches(on.nodes.ravel(), each[0].ravel(), each[1].reshape(-1, 2))

    return jax.lax.map(one, places)


def _alone(model: Model, state: State) -> tuple[Loads, State]:
    """The actuators, and their part of a state."""
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
    return loads, State(state.z, *own)


def push_response(model: Model, patches: Patches, inverse: Solve, state: State) -> Float[Array, "s k"]:
    """Readings per newton (s, k) [SI/N] on patches (s,), with K⁻¹ at a state as the map `inverse`."""
    loads, at = _alone(model, state)
    linear = linearise(model.body, loads, inverse, at)
    y = loads.values(model.body, at.z)
    slope = slopes(linear.held, (at.force, at.internal), y, at.drive)
    system = coupled(loads, linear, slope)
    q = at.force.shape[0]

    def read(alone):
        dz, dx = system.respond(alone[:, None], jnp.zeros((system.whole.shape[0], 1)))
        force = dx[:q, 0] - loads.supports * (system.pushed.T @ dz[:, 0])
        moved = State(dz[:, 0], force, dx[q:, 0], jnp.zeros_like(at.drive))
        return jax.jvp(lambda s: model.reading(s), (at,), (moved,))[1]

    by_motion = jax.jacrev(read)(jnp.zeros(model.body.n))
    by_force = inverse(by_motion.T).T
    # One refinement: the factor may be that of a state nearby.
    left = by_motion - stiffness_map(model.body, loads, at)(by_force.T).T
    by_force = by_force + inverse(left.T).T
    positions = model.body.rest + model.body.watched(state.z)

    def one(patch):
        tangents = jnp.einsum("mk,mi->ki", patch.slope, positions[patch.nodes])
        across = jnp.cross(tangents[0], tangents[1])
        force = patch.part[:, None] * across / jnp.linalg.norm(across)
        return by_force @ model.body.spread(patch.nodes, force[..., None])[:, 0]

    return jax.lax.map(one, patches)


@eqx.filter_jit
def push_response_by_factor(
    model: Model, patches: Patches, factor: PyTree[Array], state: State
) -> Float[Array, "s k"]:
    """`push_response` by a factor of the model's solver, of a tangent not far from the state's."""
    return push_response(model, patches, lambda b: model.linear.solve(factor, b), state)


@eqx.filter_jit
def push_response_at(model: Model, patches: Patches, state: State) -> Float[Array, "s k"]:
    """`push_response` by a factor of its own."""
    loads, at = _alone(model, state)
    return push_response(model, patches, tangent_at(model.linear, model.body, loads, at), state)
