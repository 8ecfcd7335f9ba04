"""A soft sensing device: a body, what is attached to it and what may touch it, and what its sensors read.

`reading(z)` is the measurement model s(q), for vented cavities ΔV(q) of Navarro et al. 2020, eq. 8;
`jax.jacfwd` of it through the equilibrium is the compliance W_va. Drives are ordered contacts first, then the
attached loads.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.load import AbstractContact, AbstractLoad, Loads
from softfuse.equilibrium.newton import Newton, solve
from softfuse.equilibrium.solution import Solution, State
from softfuse.functional.base import Functional


class Device(eqx.Module):
    """Body, k sensors, what may touch, and loads that are always there, such as cables and sealed cavities.

    The place of each contact, a location (3,) m or the number of an electrode as `contact` wants it, is given
    with each use.
    """

    body: Body
    sensors: tuple[Functional, ...]
    contact: AbstractContact
    linear: AbstractLinearSolver
    attached: tuple[AbstractLoad, ...] = ()

    def loads(self, places: Sequence[Array] | Array) -> Loads:
        """The loads under contacts at places (c, ...)."""
        touching = [self.contact.load(self.body, place) for place in places]
        return Loads((*touching, *self.attached))

    def rest_state(self, places: Sequence[Array] | Array) -> State:
        """The undeformed state under contacts at places (c, ...) without force."""
        return State.rest(self.body, self.loads(places))

    def reading(self, z: Float[Array, " n"]) -> Float[Array, " k"]:
        """What the sensors read at the body's unknowns z (n,), minus what they read at rest (k,), in SI."""

        def read(positions):
            return jnp.stack([sensor(positions) for sensor in self.sensors])

        return read(self.body.rest + self.body.displacement(z)) - read(self.body.rest)


@eqx.filter_jit
def simulate(
    device: Device, places: Array, drive: Float[Array, " D"], start: State | None = None
) -> Solution:
    """The equilibrium under contacts at places (c, ...) and drives (D,), searched from rest or `start`.

    `drive`: the contacts' total forces [N], then what the attached loads prescribe. Pure and differentiable
    in everything; `Solution.result` says how it ended.
    """
    loads = device.loads(places)
    start = State.rest(device.body, loads) if start is None else start
    return solve(Newton(device.linear), device.body, loads, drive, start)


@eqx.filter_jit
def compliance(
    device: Device, places: Array, drive: Float[Array, " D"], start: State | None = None
) -> Float[Array, "k D"]:
    """W = ∂s/∂u (k, D), readings per drive, at the equilibrium under drives (D,): one linear solve for
    each.
    """

    def measured(given):
        return device.reading(simulate(device, places, given, start).state.z)

    return jax.jacfwd(measured)(drive)
