"""What an equilibrium is, and how its search ended."""

import json
from dataclasses import fields
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.errors import SolveError
from softfuse.mechanics.load import Loads


class RESULTS(eqx.Enumeration):
    """How a solve ended; data inside jit, turned into words or an exception at the edge."""

    converged = "converged"
    snapped = "snapped: on the way the body jumped to another shape, and this is the equilibrium after it"
    diverged = "diverged: no load step converged; the body may have collapsed, or cannot carry the load"
    inverted = (
        "inverted element: the load turns an element inside out; refine the mesh there or lower the load"
    )
    step_limit = "step limit: more load steps are needed; raise max_load_steps"


_NAMES = ("converged", "snapped", "diverged", "inverted", "step_limit")


def result_name(result: RESULTS) -> str:
    """The name of how a solve ended, such as "converged"; `RESULTS[result]` says it in a sentence."""
    return next(name for name in _NAMES if bool(result == getattr(RESULTS, name)))


class State(eqx.Module):
    """What changes while a body deforms under its loads.

    `z` (n,): the body's unknowns; `force` (Q,): of the ports that carry one; `internal` (M,): the loads' own
    unknowns; `drive` (D,): what is prescribed.
    """

    z: Float[Array, " n"]
    force: Float[Array, " Q"]
    internal: Float[Array, " M"]
    drive: Float[Array, " D"]

    @classmethod
    def rest(cls, body: AbstractBody, loads: Loads) -> "State":
        """The undeformed state."""
        return cls(jnp.zeros(body.n), *loads.start())

    def of_last(self, loads: Loads) -> "State":
        """What of it is the body's and that of loads which are the last on it."""
        sizes = loads.sizes
        counts = (self.force, sizes.forces), (self.internal, sizes.internal), (self.drive, sizes.drives)
        return State(self.z, *(each[each.shape[0] - count :] for each, count in counts))

    def lists(self) -> dict[str, list[float]]:
        """All of it as plain numbers, for a file that `read_state` reads."""
        return {each.name: np.asarray(getattr(self, each.name)).tolist() for each in fields(self)}


def read_state(path: Path, like: State) -> State:
    """The state in a JSON file of `softfuse simulate`, for a body and loads with as many unknowns as `like`
    has. Raises SolveError for any other file.
    """
    try:
        lists = json.loads(path.read_text())["state"]
        found = State(**{each.name: jnp.asarray(lists[each.name], float) for each in fields(State)})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SolveError(
            f"{path}: no state to begin with ({error}): give a file that softfuse simulate --json wrote"
        ) from error
    for each in fields(State):
        have, want = getattr(found, each.name).shape, getattr(like, each.name).shape
        if have != want:
            raise SolveError(
                f"{path}: state.{each.name} has {have[0]} numbers, this body and its loads have {want[0]}: "
                "begin with a state of the same mesh, contact and cables"
            )
    return found


class Stats(eqx.Module):
    """What a solve took: Newton iterations, accepted load steps, those of them in which the body snapped;
    which part of the way from the start to its drives, and to its whole weight, it has come, and the largest
    unbalanced nodal force [N] there.
    """

    newton_iterations: Int[Array, ""]
    load_steps: Int[Array, ""]
    snaps: Int[Array, ""]
    reached: Float[Array, ""]
    residual: Float[Array, ""]


class Solution(eqx.Module):
    """A state, how its search ended, and what it took; on failure the last state that was an equilibrium."""

    state: State
    result: RESULTS
    stats: Stats

    @property
    def success(self) -> bool:
        """Whether the state is an equilibrium under all that was asked for, after snaps or without."""
        return bool((self.result == RESULTS.converged) | (self.result == RESULTS.snapped))

    @property
    def snapped(self) -> bool:
        """Whether it snapped on the way there."""
        return bool(self.result == RESULTS.snapped)

    @property
    def words(self) -> str:
        """How the search ended, in a sentence."""
        return RESULTS[self.result]
