"""The mechanical model of a robot: a body, what acts on it, what may touch it, and what its sensors read.

`reading(state)` is the measurement model s(q), for vented chambers ΔV(q) of Navarro et al. 2020, eq. 8;
`jax.jacfwd` of it through the equilibrium is the compliance W_va. Drives are ordered contacts first, then the
actuators.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from softfuse.body.base import AbstractBody
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import AbstractContact, AbstractLoad, Loads
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.reading import AbstractReading, Equilibrium
from softfuse.mechanics.solution import Solution, State

_Part = TypeVar("_Part")


class Model(eqx.Module):
    """Body, readings, kinds of contacts, and the loads that are always there, such as cables and chambers.

    `slots`: of which of the `contacts` each contact is that is followed at once; with one kind all are of it,
    however many. The place of each (3, 3), see `functional.chart`, is given with each use.
    """

    body: AbstractBody
    readings: tuple[AbstractReading, ...]
    contacts: tuple[AbstractContact, ...]
    linear: AbstractLinearSolver
    actuators: tuple[AbstractLoad, ...] = ()
    slots: tuple[int, ...] = eqx.field(static=True, default=())

    @property
    def n_readings(self) -> int:
        """Number k of readings."""
        return sum(reading.count for reading in self.readings)

    @property
    def answered(self) -> Int[np.ndarray, " k"]:
        """The actuators' drive (k,) that each reading answers; -1 for those that answer none."""
        return np.array([number for reading in self.readings for number in reading.answered], int)

    @property
    def driven(self) -> Int[np.ndarray, " k"]:
        """The actuators' drive (k,) that each reading is; -1 for those that are none."""
        return np.array([number for reading in self.readings for number in reading.driven], int)

    def kinds(self, count: int) -> tuple[AbstractContact, ...]:
        """What each of so many contacts is."""
        slots = self.slots if len(self.contacts) > 1 else (0,) * count
        return tuple(self.contacts[slot] for slot in slots[:count])

    def adding(self, count: int) -> Float[np.ndarray, "c F"]:
        """The matrix (c, F) that adds the forces F of so many contacts up to that along each one's normal."""
        each = [kind.shares > 0 for kind in self.kinds(count)]
        return self.owning(count) * np.concatenate([np.zeros(0), *each])

    def owning(self, count: int) -> Float[np.ndarray, "c F"]:
        """1 for the forces F of each of so many contacts, else 0 (c, F)."""
        return np.repeat(np.eye(count), [kind.drives for kind in self.kinds(count)], axis=1)

    def loads(self, places: Sequence[Array] | Array | np.ndarray) -> Loads:
        """The loads under contacts at places (c, 3, 3)."""
        kinds = self.kinds(len(places))
        touching = [
            kind.load(self.body, jnp.asarray(place)) for kind, place in zip(kinds, places, strict=True)
        ]
        return Loads((*touching, *self.actuators))

    def rest_state(self, places: Sequence[Array] | Array | np.ndarray) -> State:
        """The undeformed state under contacts at places (c, 3, 3) without force."""
        return State.rest(self.body, self.loads(places))

    def reading(self, state: State, places: Sequence[Array] | Array | np.ndarray = ()) -> Float[Array, " k"]:
        """What the sensors read in a state under contacts at places (c, 3, 3), minus what they read at rest
        (k,), in SI; the places only matter to readings that see the contacts' forces, see
        `AbstractReading.of`.
        """
        contacts = Loads(tuple(self.loads(places).parts[: len(places)]))
        at = Equilibrium(self.body, contacts, Loads(self.actuators), state)
        return jnp.concatenate([jnp.zeros(0), *(reading.of(at) for reading in self.readings)])

    def answers(self, state: State) -> Float[Array, " a"]:
        """What answers the actuators' drives (a,), see `AbstractLoad.conjugate`."""
        return Equilibrium(self.body, Loads(()), Loads(self.actuators), state).answers

    def depths(self, places: Sequence[Array] | Array | np.ndarray, state: State) -> Float[Array, " c"]:
        """How far each of contacts at places (c, 3, 3) has sunk in (c,) [m], the mean of its parts; or how
        hard it presses [N], where it is driven by its depth.
        """
        count = len(places)
        touching = Loads(self.loads(places).parts[:count])
        force, internal = state.force[: touching.sizes.forces], state.internal[: touching.sizes.internal]
        answers = touching.conjugate(force, internal, touching.values(self.body, state.z))
        shares = np.concatenate([np.zeros(0), *(kind.shares for kind in self.kinds(count))])
        return jnp.asarray(self.owning(count) * shares) @ answers

    def depth(self, places: Sequence[Array] | Array | np.ndarray, state: State) -> Float[Array, ""]:
        """That of the first contact."""
        return self.depths(places[:1], state)[0]


def with_body(model: Model, body: AbstractBody) -> Model:
    """The same model of a body with other rest nodes or materials, in which its gas was sealed."""
    sealed = with_actuators(model, SealedGas, lambda gas: gas.sealed_in(body))
    return eqx.tree_at(lambda m: m.body, sealed, body)


def parts_of(tree: PyTree, *kinds: type[_Part]) -> list[_Part]:
    """All parts of some kinds in a tree of modules, in its order."""
    parts = jax.tree.leaves(tree, is_leaf=lambda part: isinstance(part, kinds))
    return [part for part in parts if isinstance(part, kinds)]


def with_actuators(model: Model, kind: type[_Part], changed: Callable[[_Part], _Part]) -> Model:
    """The model whose actuators of a kind are changed, one after the other."""
    return eqx.tree_at(lambda m: parts_of(m.actuators, kind), model, replace_fn=changed)


@eqx.filter_jit
def simulate(model: Model, places: Array, drive: Float[Array, " D"], start: State | None = None) -> Solution:
    """The equilibrium under contacts at places (c, 3, 3) and drives (D,), searched from rest or `start`.

    `drive`: the contacts' total forces [N], then what the actuators are driven with. Pure and differentiable
    in everything; `Solution.result` says how it ended.
    """
    loads = model.loads(places)
    start = State.rest(model.body, loads) if start is None else start
    return solve(Newton(model.linear), model.body, loads, drive, start)


@eqx.filter_jit
def compliance(
    model: Model, places: Array | np.ndarray, drive: Float[Array, " D"], start: State | None = None
) -> Float[Array, "k D"]:
    """W = ∂s/∂u (k, D), readings per drive, at the equilibrium under drives (D,): one linear
    solve for each.
    """
    places = jnp.asarray(places)

    def measured(given):
        return model.reading(simulate(model, places, given, start).state, places)

    return jax.jacfwd(measured)(drive)
