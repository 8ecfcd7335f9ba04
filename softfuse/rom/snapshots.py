"""States to learn modes from: equilibria along paths of loads, and one Newton step from each to what is near.

A step with the factor that the equilibrium was found with costs a tenth of an equilibrium, and what it shows,
how the body answers when its loads move or grow a little, exact to first order in the difference, is what a
subspace of equilibria alone lacks.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from softfuse.body.base import AbstractBody
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.linearised import linearise, loaded_tangents, settled_on
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State
from softfuse.rom.load_paths import LoadPath

_FAR = 0.01
"""Of the body's size: a step that moves a node further asks for a new factor."""

_SHRINKS = 0.15
"""A step that is longer than this part of the last one asks for a new factor."""

_LEAST_STEP = 1 / 32
"""Of the way from level to level."""

LoadsAt = Callable[[AbstractBody, Array], Loads]
"""The loads on a body at places (c, 3, 3)."""


class Found(eqx.Module):
    """A state, the rough factor of a tangent near it, whether it is an equilibrium with no element inside
    out, and how many steps and factors it took.
    """

    state: State
    factor: PyTree[Array]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    factors: Int[Array, ""]


def rough_factor(
    linear: AbstractLinearSolver, body: AbstractBody, loads: Loads, state: State
) -> PyTree[Array]:
    """The factor, good enough to be refined, of the loaded body's tangent at a state."""
    return linear.rough().factor(loaded_tangents(body, loads, state))


def step_to(
    linear: AbstractLinearSolver,
    body: AbstractBody,
    loads: Loads,
    drive: Float[Array, " D"],
    state: State,
    factor: PyTree[Array],
) -> tuple[State, Bool[Array, ""]]:
    """One Newton step from a state towards the equilibrium under `loads` at drives (D,), with a factor of
    `rough_factor`; and whether the loads' laws could be met on the linearised body.

    `loads` may be others than those of the state, such as a disc at another place, with as many unknowns.
    """
    solver = linear.rough()
    at = State(state.z, state.force, state.internal, drive)
    linear_body = linearise(body, loads, lambda b: solver.solve(factor, b), at)
    settled, y = settled_on(linear_body, at)
    force = linear_body.held.force(settled.force, y)
    z = state.z + linear_body.step(settled.force)
    return State(z, force, settled.internal, drive), settled.found


class _Search(eqx.Module):
    state: State
    factor: PyTree[Array]
    length: Float[Array, ""]
    renew: Bool[Array, ""]
    settled: Bool[Array, ""]
    steps: Int[Array, ""]
    factors: Int[Array, ""]


def follow(
    linear: AbstractLinearSolver,
    body: AbstractBody,
    loads: Loads,
    drive: Float[Array, " D"],
    start: State,
    factor: PyTree[Array],
    *,
    step_tolerance: float = 1e-9,
    max_steps: int = 40,
) -> Found:
    """The equilibrium under `loads` at drives (D,), searched from `start` with a factor of a tangent near it.

    Newton's method with a stale factor (the chord method) converges linearly, at the rate by which the
    tangents differ; a new factor is made where a step has not become much shorter than the one before, or is
    so long that it turns parts of the body. Source: Kelley, Iterative Methods for Linear and Nonlinear
    Equations, 1995, ch. 5.

    It has converged when no displacement changes by more than `step_tolerance` [m]. Unlike `solve`, it takes
    no care of large increments: start near enough. Pure; not meant to be differentiated.
    """

    def unfinished(at: _Search):
        return (at.length > step_tolerance) & (at.steps < max_steps)

    def advance(at: _Search) -> _Search:
        renewed = jax.lax.cond(
            at.renew, lambda: rough_factor(linear, body, loads, at.state), lambda: at.factor
        )
        after, settled = step_to(linear, body, loads, drive, at.state, renewed)
        length = jnp.max(jnp.abs(body.motion(after.z - at.state.z)))
        # A factor that was just made gets a second step before it is judged.
        renew = ((length > _SHRINKS * at.length) & ~at.renew) | (length > far)
        return _Search(after, renewed, length, renew, settled, at.steps + 1, at.factors + at.renew)

    far = _FAR * jnp.max(jnp.ptp(body.rest, axis=0))
    first = _Search(
        start, factor, jnp.array(jnp.inf), jnp.array(False), jnp.array(True), jnp.array(0), jnp.array(0)
    )
    last = jax.lax.while_loop(unfinished, advance, first)
    converged = (last.length <= step_tolerance) & last.settled
    converged &= jnp.min(body.volume_ratios(last.state.z)) > 0
    return Found(last.state, last.factor, converged, last.steps, last.factors)


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


def snapshots(
    linear: AbstractLinearSolver, body: AbstractBody, loads_at: LoadsAt, paths: Iterable[LoadPath]
) -> Snapshots:
    """The states of a body on load paths with as many levels and as much near them, each followed from rest.

    Steps between levels are halved where they are too large; a path is left where that does not help.
    """
    follower = _Follower(linear, body, loads_at)
    z, found = zip(*(follower.along(path) for path in paths), strict=True)
    return Snapshots(np.stack(z), np.stack(found))


class _Follower(eqx.Module):
    """Follows a body along load paths."""

    linear: AbstractLinearSolver
    body: AbstractBody
    loads_at: LoadsAt

    def along(
        self, path: LoadPath
    ) -> tuple[Float[np.ndarray, "l k_plus_1 n"], Bool[np.ndarray, "l k_plus_1"]]:
        """See `Snapshots`, of one path."""
        state, factor = self.begin(path.place)
        z, found, alive, step = [], [], True, 1.0
        for level, places, drives in zip(path.levels, path.near_places, path.near_drives, strict=True):
            if alive:
                state, factor, step = self.reach(path.place, level, state, factor, step)
                alive = step > 0
            around, settled = np.tile(np.asarray(state.z), (len(drives), 1)), np.zeros(len(drives), bool)
            if alive and len(drives):
                near = self.near(places, jnp.asarray(drives, float), state, factor)
                around, settled = (np.asarray(part) for part in near)
            z.append(np.concatenate([np.asarray(state.z)[None], around]))
            found.append(np.append(alive, settled))
        return np.stack(z), np.stack(found)

    def reach(
        self, place: Array, level: Float[np.ndarray, " D"], state: State, factor: PyTree[Array], step: float
    ) -> tuple[State, PyTree[Array], float]:
        """The equilibrium at drives (D,), with a factor near it, first tried in steps of such a part of the
        way; and what part was good at last: 0 where none was, with the last equilibrium that was found.
        """
        begin, done = np.asarray(state.drive), 0.0
        while done < 1:
            end = min(done + step, 1.0)
            reached = self.go_on(place, jnp.asarray(begin + end * (level - begin)), state, factor)
            if reached.converged:
                state, factor, done = reached.state, reached.factor, end
            elif step > _LEAST_STEP:
                step /= 2
            else:
                return state, factor, 0.0
        return state, factor, min(2 * step, 1.0)

    @eqx.filter_jit
    def begin(self, place: Array) -> tuple[State, PyTree[Array]]:
        """Rest, and a factor there."""
        loads = self.loads_at(self.body, place)
        rest = State.rest(self.body, loads)
        return rest, rough_factor(self.linear, self.body, loads, rest)

    @eqx.filter_jit
    def go_on(self, place: Array, drive: Float[Array, " D"], state: State, factor: PyTree[Array]) -> Found:
        """The equilibrium at a drive."""
        return follow(self.linear, self.body, self.loads_at(self.body, place), drive, state, factor)

    @eqx.filter_jit
    def near(
        self, places: Array, drives: Float[Array, "k D"], state: State, factor: PyTree[Array]
    ) -> tuple[Float[Array, "k n"], Bool[Array, " k"]]:
        """The unknowns one step away, and whether these are states."""

        def stepped(near):
            place, drive = near
            loads = self.loads_at(self.body, place)
            after, settled = step_to(self.linear, self.body, loads, drive, state, factor)
            return after.z, settled & (jnp.min(self.body.volume_ratios(after.z)) > 0)

        return jax.lax.map(stepped, (places, drives))
