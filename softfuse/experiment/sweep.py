"""Many presses of one device: series of equilibria at one place, each searched from the one before."""

from collections.abc import Iterator
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.estimation.device import Device, simulate
from softfuse.mechanics.punch import PunchContact
from softfuse.mechanics.solution import State, result_name

OVERHANGS = "overhangs"
"""The result of a case in which a disc does not stand on the body with all of its face: nothing is solved."""


@dataclass(frozen=True)
class Series:
    """What is the same in some cases, and the forces in which they differ.

    number: of the first case; modulus_factor: of all moduli; cables: the shortening [m] or tension [N] of
    each; places: of each contact, x and y [m] of a disc's middle or the number of an electrode; forces:
    ascending, of each contact [N].
    """

    number: int
    modulus_factor: float
    cables: tuple[float, ...]
    places: tuple[tuple[float, float] | int, ...]
    forces: tuple[float, ...]


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


def drives_of(device: Device, series: Series, rest: Float[np.ndarray, " D"]) -> Float[np.ndarray, "m D"]:
    """The drives (m, D) of the cases of a series: forces, then cables, then what the body at rest has.

    The cables come first among what is attached to the device.
    """
    pressed = device.contact.drives * len(series.places)
    driven = pressed + len(series.cables)
    drives = np.tile(rest, (len(series.forces), 1))
    drives[:, :pressed] = np.array(series.forces)[:, None] / device.contact.drives
    drives[:, pressed:driven] = series.cables
    return drives


def places_of(device: Device, series: Series) -> Array:
    """The places (c, ...) of a series as the device's contact wants them."""
    if isinstance(device.contact, PunchContact):
        return jnp.array([(*place, 0.0) for place in series.places if not isinstance(place, int)])
    return jnp.array(series.places)


def outcomes(device: Device, series: Series) -> Iterator[Outcome]:
    """How the cases of a series end on a device of these moduli and cables, one by one.

    Each is searched from the last one that was found, the first from rest.
    """
    places = places_of(device, series)
    if isinstance(device.contact, PunchContact) and float(_least_overlap(device, places)) < 1.0:
        nothing = np.full(device.readings, np.nan)
        yield from (Outcome(OVERHANGS, 0, 0, np.nan, nothing, np.nan) for _ in series.forces)
        return
    at = _rest(device, places)
    for drive in drives_of(device, series, np.asarray(at.drive)):
        solution = simulate(device, places, jnp.asarray(drive), at)
        reading, largest = _measured(device, solution.state)
        name = result_name(solution.result)
        found = solution.success
        at = solution.state if found else at
        yield Outcome(
            name,
            int(solution.stats.newton_iterations),
            int(solution.stats.load_steps),
            float(solution.stats.residual),
            np.asarray(reading) if found else np.full(device.readings, np.nan),
            float(largest) if found else np.nan,
        )


@eqx.filter_jit
def _least_overlap(device: Device, places: Float[Array, "c 3"]) -> Float[Array, ""]:
    assert isinstance(device.contact, PunchContact)
    return jnp.min(jnp.stack([device.contact.at(place).overlap(device.body) for place in places]))


@eqx.filter_jit
def _rest(device: Device, places: Array) -> State:
    return device.rest_state(places)


@eqx.filter_jit
def _measured(device: Device, state: State) -> tuple[Float[Array, " k"], Float[Array, ""]]:
    moved = jnp.linalg.norm(device.body.displacement(state.z), axis=1)
    return device.reading(state), jnp.max(moved)
