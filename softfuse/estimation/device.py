"""A soft sensing device: a body, what is attached to it and what may touch it, and what its sensors read.

`reading(state)` is the measurement model s(q), for vented cavities ΔV(q) of Navarro et al. 2020, eq. 8;
`jax.jacfwd` of it through the equilibrium is the compliance W_va. Drives are ordered contacts first, then the
attached loads.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.base import AbstractFunctional
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import AbstractContact, AbstractLoad, Loads
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.solution import Solution, State

_Load = TypeVar("_Load", bound=AbstractLoad)


class Device(eqx.Module):
    """Body, sensors, what may touch, and loads that are always there, such as cables and sealed cavities.

    Readings are those of the `sensors`, functionals of the configuration, then what answers the attached
    loads' drives numbered in `gauges`: a cable's shortening, the pressure of sealed gas. The place of each
    contact, a location (3,) m or the number of an electrode as `contact` wants it, is given with each use.
    """

    body: AbstractBody
    sensors: tuple[AbstractFunctional, ...]
    contact: AbstractContact
    linear: AbstractLinearSolver
    attached: tuple[AbstractLoad, ...] = ()
    gauges: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def readings(self) -> int:
        """Number k of readings."""
        return sum(sensor.count for sensor in self.sensors) + len(self.gauges)

    def loads(self, places: Sequence[Array] | Array) -> Loads:
        """The loads under contacts at places (c, ...)."""
        touching = [self.contact.load(self.body, place) for place in places]
        return Loads((*touching, *self.attached))

    def rest_state(self, places: Sequence[Array] | Array) -> State:
        """The undeformed state under contacts at places (c, ...) without force."""
        return State.rest(self.body, self.loads(places))

    def reading(self, state: State) -> Float[Array, " k"]:
        """What the sensors read in a state, those of positions minus their reading at rest (k,), in SI."""

        changes = [jnp.ravel(sensor.change(self.body, state.z)) for sensor in self.sensors]
        return jnp.concatenate([*changes, self.answers(state)[np.array(self.gauges, int)]])

    def answers(self, state: State) -> Float[Array, " a"]:
        """What answers the attached loads' drives (a,), see `AbstractLoad.conjugate`."""
        attached = Loads(self.attached)
        if not self.attached:
            return jnp.zeros(0)
        force = state.force[state.force.shape[0] - attached.sizes.forces :]
        internal = state.internal[state.internal.shape[0] - attached.sizes.internal :]
        return attached.conjugate(force, internal, attached.values(self.body, state.z))

    def depth(self, places: Sequence[Array] | Array, state: State) -> Float[Array, ""]:
        """How far the first of contacts at places (c, ...) has sunk in [m], the mean of an electrode's
        patches.
        """
        touching = Loads((self.contact.load(self.body, places[0]),))
        force, internal = state.force[: touching.sizes.forces], state.internal[: touching.sizes.internal]
        return jnp.mean(touching.conjugate(force, internal, touching.values(self.body, state.z)))


def with_body(device: Device, body: AbstractBody) -> Device:
    """The same device of a body with other rest nodes or materials, in which its gas was sealed."""
    sealed = with_attached(device, SealedGas, lambda gas: gas.sealed_in(body))
    return eqx.tree_at(lambda d: d.body, sealed, body)


def with_attached(device: Device, kind: type[_Load], changed: Callable[[_Load], _Load]) -> Device:
    """The device whose attached loads of a kind are changed, one after the other."""
    attached = tuple(changed(load) if isinstance(load, kind) else load for load in device.attached)
    return eqx.tree_at(lambda d: d.attached, device, attached)


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
    """W = ∂s/∂u (k, D), readings per drive, at the equilibrium under drives (D,): one linear
    solve for each.
    """

    def measured(given):
        return device.reading(simulate(device, places, given, start).state)

    return jax.jacfwd(measured)(drive)
