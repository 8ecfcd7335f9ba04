"""States to learn modes from: equilibria along load paths, and one Newton step from each to what is near.

A step with the factor that the equilibrium was found with costs a tenth of an equilibrium, and what it shows,
how the body answers when its loads move or grow a little, is what a subspace of equilibria alone lacks.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from softfuse.body.base import AbstractBody
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State
from softfuse.rom.equilibria import Found, follow, rough_factor, step_to
from softfuse.rom.load_paths import LoadPath

_LEAST_STEP = 1 / 32
"""Of the way from level to level."""

LoadsAt = Callable[[AbstractBody, Array], Loads]
"""The loads on a body at places (c, 3, 3)."""


class Snapshots(NamedTuple):
    """Unknowns (p, l, 1 + k, n) at each level of each load path: the equilibrium, then what is near it; and
    which were found (p, l, 1 + k). What was not is the last that was.
    """

    z: Float[np.ndarray, "p l k_plus_1 n"]
    found: Bool[np.ndarray, "p l k_plus_1"]

    @property
    def states(self) -> Float[np.ndarray, "s n"]:
        """All that were found (s, n)."""
        return self.z[self.found]

    @property
    def equilibria(self) -> Float[np.ndarray, "s n"]:
        """The equilibria that were found (s, n)."""
        return self.z[:, :, 0][self.found[:, :, 0]]


def snapshots(
    linear: AbstractLinearSolver, body: AbstractBody, loads_at: LoadsAt, paths: Iterable[LoadPath]
) -> Snapshots:
    """The states of a body on load paths with as many levels and as much near them, each followed from rest.

    Steps between levels are halved where they are too large; a path is left where that does not help.
    """
    each = [_along(linear, body, loads_at, path) for path in paths]
    z, found = zip(*each, strict=True)
    return Snapshots(np.stack(z), np.stack(found))


def _along(
    linear: AbstractLinearSolver, body: AbstractBody, loads_at: LoadsAt, path: LoadPath
) -> tuple[Float[np.ndarray, "l k_plus_1 n"], Bool[np.ndarray, "l k_plus_1"]]:
    state, factor = _begin(loads_at, linear, body, path.place)
    z, found, alive, step = [], [], True, 1.0
    for level, places, drives in zip(path.levels, path.near_places, path.near_drives, strict=True):
        if alive:
            reached = _reach(loads_at, linear, body, path.place, level, state, factor, step)
            state, factor, step = reached
            alive = step > 0
        around, settled = np.tile(np.asarray(state.z), (len(drives), 1)), np.zeros(len(drives), bool)
        if alive and len(drives):
            near = _near(loads_at, linear, body, places, jnp.asarray(drives, float), state, factor)
            around, settled = (np.asarray(part) for part in near)
        z.append(np.concatenate([np.asarray(state.z)[None], around]))
        found.append(np.append(alive, settled))
    return np.stack(z), np.stack(found)


def _reach(
    loads_at: LoadsAt,
    linear: AbstractLinearSolver,
    body: AbstractBody,
    place: Array,
    level: Float[np.ndarray, " D"],
    state: State,
    factor: PyTree[Array],
    step: float,
) -> tuple[State, PyTree[Array], float]:
    """The equilibrium at drives (D,), with a factor near it, first tried in steps of such a part of the way;
    and what part was good at last: 0 where none was, with the last equilibrium that was found.
    """
    begin, done = np.asarray(state.drive), 0.0
    while done < 1:
        end = min(done + step, 1.0)
        drive = jnp.asarray(begin + end * (level - begin))
        reached = _go_on(loads_at, linear, body, place, drive, state, factor)
        if reached.converged:
            state, factor, done = reached.state, reached.factor, end
        elif step > _LEAST_STEP:
            step /= 2
        else:
            return state, factor, 0.0
    return state, factor, min(2 * step, 1.0)


@eqx.filter_jit
def _begin(
    loads_at: LoadsAt, linear: AbstractLinearSolver, body: AbstractBody, place: Array
) -> tuple[State, PyTree[Array]]:
    loads = loads_at(body, place)
    rest = State.rest(body, loads)
    return rest, rough_factor(linear, body, loads, rest)


@eqx.filter_jit
def _go_on(
    loads_at: LoadsAt,
    linear: AbstractLinearSolver,
    body: AbstractBody,
    place: Array,
    drive: Float[Array, " D"],
    state: State,
    factor: PyTree[Array],
) -> Found:
    return follow(linear, body, loads_at(body, place), drive, state, factor)


@eqx.filter_jit
def _near(
    loads_at: LoadsAt,
    linear: AbstractLinearSolver,
    body: AbstractBody,
    places: Array,
    drives: Float[Array, "k D"],
    state: State,
    factor: PyTree[Array],
) -> tuple[Float[Array, "k n"], Bool[Array, " k"]]:
    def stepped(near):
        place, drive = near
        after, settled = step_to(linear, body, loads_at(body, place), drive, state, factor)
        return after.z, settled & (jnp.min(body.volume_ratios(after.z)) > 0)

    return jax.lax.map(stepped, (places, drives))
