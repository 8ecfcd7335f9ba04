"""The cases of a sweep: equilibria under contacts at one place, each searched from the one before."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.solution import State, result_name
from softfuse.robot.press_series import Series

OVERHANGS = "overhangs"
"""The result of a case in which a disc does not stand on the body with all of its face: nothing is solved."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """How one case ended, in SI: a name of `RESULTS` or `OVERHANGS`, and what the search took.

    reading (k,): of the robot; answer (c,): how deep each contact goes, or how hard it presses where it is
    driven by its depth; largest_displacement: of a node; NaN unless converged, and so is residual of what was
    not solved.
    """

    result: str
    newton_iterations: int
    load_steps: int
    residual: float
    reading: Float[np.ndarray, " k"]
    answer: Float[np.ndarray, " c"]
    largest_displacement: float


def drives_of(
    model: Model, series: Series, rest: Float[np.ndarray, " D"], driven: Sequence[int]
) -> Float[np.ndarray, "m D"]:
    """The drives (m, D) of the cases of a series: of the contacts, then of the actuators, of which those of
    these numbers are `driven`, the others as at rest.
    """
    shares = np.concatenate([np.zeros(0), *(kind.shares for kind in model.kinds(len(series.places)))])
    drives = np.tile(rest, (len(series.levels), 1))
    drives[:, : len(shares)] = np.array(series.levels)[:, None] * shares
    drives[:, len(shares) + np.array(driven, int)] = series.driven
    return drives


def outcomes(
    model: Model, series: Series, places: Float[Array, "c 3 3"], driven: Sequence[int]
) -> Iterator[Outcome]:
    """How the cases of a series at places (c, 3, 3) end on a robot of these moduli, one by one; `driven`: see
    `drives_of`.

    Each is searched from the last one that was found, the first from rest.
    """
    none = np.full(model.n_readings, np.nan), np.full(len(places), np.nan)
    if len(places) and not _stands(model, places):
        yield from (Outcome(OVERHANGS, 0, 0, np.nan, *none, np.nan) for _ in series.levels)
        return
    at = _rest(model, places)
    for drive in drives_of(model, series, np.asarray(at.drive), driven):
        solution = simulate(model, places, jnp.asarray(drive), at)
        reading, answer, largest = _measured(model, places, solution.state)
        name = result_name(solution.result)
        found = solution.success
        at = solution.state if found else at
        yield Outcome(
            name,
            int(solution.stats.newton_iterations),
            int(solution.stats.load_steps),
            float(solution.stats.residual),
            *((np.asarray(reading), np.asarray(answer)) if found else none),
            float(largest) if found else np.nan,
        )


@eqx.filter_jit
def _stands(model: Model, places: Float[Array, "c 3 3"]) -> Bool[Array, ""]:
    each = zip(model.kinds(len(places)), places, strict=True)
    return jnp.all(jnp.stack([kind.stands(model.body, place) for kind, place in each]))


@eqx.filter_jit
def _rest(model: Model, places: Array) -> State:
    return model.rest_state(places)


@eqx.filter_jit
def _measured(
    model: Model, places: Array, state: State
) -> tuple[Float[Array, " k"], Float[Array, " c"], Float[Array, ""]]:
    moved = jnp.linalg.norm(model.body.displacement(state.z), axis=1)
    return model.reading(state, places), model.depths(places, state), jnp.max(moved)
