"""Equilibria to learn modes from: loads at many places, each followed from rest through rising levels."""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.body.base import AbstractBody
from softfuse.equilibrium.linear_solver import AbstractLinearSolver
from softfuse.equilibrium.load import Loads
from softfuse.equilibrium.solution import State
from softfuse.reduction.equilibria import follow, rough_factor


class Snapshots(NamedTuple):
    """Unknowns (p, l, n) at p places and l levels of the drives, and which are equilibria (p, l); what is not
    is the last that was.
    """

    z: Float[np.ndarray, "p l n"]
    found: Bool[np.ndarray, "p l"]

    @property
    def states(self) -> Float[np.ndarray, "s n"]:
        """The equilibria (s, n)."""
        return self.z[self.found]


def snapshots(
    linear: AbstractLinearSolver,
    body: AbstractBody,
    loads_at: Callable[[AbstractBody, Array], Loads],
    places: Iterable[Array],
    levels: Float[np.ndarray, "l D"],
) -> Snapshots:
    """Equilibria of a body under `loads_at` (body, place) at each of some places, at drives (l, D) one level
    after the other, the first searched from rest: see `follow`.

    A place is left where a level has no equilibrium near the one before.
    """

    @eqx.filter_jit
    def begin(linear, body, place):
        loads = loads_at(body, place)
        rest = State.rest(body, loads)
        return rest, rough_factor(linear, body, loads, rest)

    @eqx.filter_jit
    def go_on(linear, body, place, drive, state, factor):
        return follow(linear, body, loads_at(body, place), drive, state, factor)

    def followed(place: Array) -> Iterator[tuple[np.ndarray, bool]]:
        state, factor = begin(linear, body, place)
        alive = True
        for level in levels:
            if alive:
                reached = go_on(linear, body, place, jnp.asarray(level, float), state, factor)
                alive = bool(reached.converged)
                if alive:
                    state, factor = reached.state, reached.factor
            yield np.asarray(state.z), alive

    z, found = zip(*(each for place in places for each in followed(place)), strict=True)
    return Snapshots(np.reshape(z, (-1, len(levels), body.n)), np.reshape(found, (-1, len(levels))))
