"""Many presses of one device: series of equilibria at one place, each searched from the one before."""

from collections.abc import Iterator
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

    reading (k,): of the device; largest_displacement: of a node; NaN unless converged, and so is residual of
    what was not solved.
    """

    result: str
    newton_iterations: int
    load_steps: int
    residual: float
    reading: Float[np.ndarray, " k"]
    largest_displacement: float


def drives_of(device: Model, series: Series, rest: Float[np.ndarray, " D"]) -> Float[np.ndarray, "m D"]:
    """The drives (m, D) of the cases of a series: forces, then cables, then what the body at rest has.

    The cables come first among what is attached to the device.
    """
    shares = np.tile(device.contacts[0].shares, len(series.places))
    pressed = len(shares)
    driven = pressed + len(series.cables)
    drives = np.tile(rest, (len(series.forces), 1))
    drives[:, :pressed] = np.array(series.forces)[:, None] * shares
    drives[:, pressed:driven] = series.cables
    return drives


def outcomes(device: Model, series: Series, places: Float[Array, "c 3 3"]) -> Iterator[Outcome]:
    """How the cases of a series at places (c, 3, 3) end on a device of these moduli and cables, one by one.

    Each is searched from the last one that was found, the first from rest.
    """
    if not _stands(device, places):
        nothing = np.full(device.n_readings, np.nan)
        yield from (Outcome(OVERHANGS, 0, 0, np.nan, nothing, np.nan) for _ in series.forces)
        return
    at = _rest(device, places)
    for drive in drives_of(device, series, np.asarray(at.drive)):
        solution = simulate(device, places, jnp.asarray(drive), at)
        reading, largest = _measured(device, places, solution.state)
        name = result_name(solution.result)
        found = solution.success
        at = solution.state if found else at
        yield Outcome(
            name,
            int(solution.stats.newton_iterations),
            int(solution.stats.load_steps),
            float(solution.stats.residual),
            np.asarray(reading) if found else np.full(device.n_readings, np.nan),
            float(largest) if found else np.nan,
        )


@eqx.filter_jit
def _stands(device: Model, places: Float[Array, "c 3 3"]) -> Bool[Array, ""]:
    each = zip(device.kinds(len(places)), places, strict=True)
    return jnp.all(jnp.stack([kind.stands(device.body, place) for kind, place in each]))


@eqx.filter_jit
def _rest(device: Model, places: Array) -> State:
    return device.rest_state(places)


@eqx.filter_jit
def _measured(device: Model, places: Array, state: State) -> tuple[Float[Array, " k"], Float[Array, ""]]:
    moved = jnp.linalg.norm(device.body.displacement(state.z), axis=1)
    return device.reading(state, places), jnp.max(moved)
