"""At which points a reduced body measures its energy: a cubature that keeps its equilibria where they are.

Points and weights are chosen such that sums over the chosen ones are those over all, f(z) = Σ_q B_qᵀ s_q,
for all training states. What is missed of a sum moves the equilibrium by K(z)⁻¹ δf, so this is what is kept
small, relative to the state's size: a force that is small beside others is not small for a soft body. Not
every mode is asked for in every state but a few random combinations of all, new ones for each: a Gaussian
sketch, which keeps the norm of what is missed (see `compressed`). A body that strains little is best summed
beyond its exact tangent at rest; one that turns is not, for its strains at rest would be large where it only
turns. Whichever leaves the points less to measure is taken.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.errors import SolveError
from softfuse.rom.cubature import Cubature, compressed, empirical_cubature
from softfuse.rom.mode_points import ModePoints, Work

_COMBINATIONS = 4
"""Of the modes, asked for in each state."""


class Sampling(NamedTuple):
    """The `cubature` of a body's points, its error relative to the states; and whether it is of what is
    `beyond_rest`, beyond the tangent at rest, or of all.
    """

    cubature: Cubature
    beyond_rest: bool


def sampled(
    points: tuple[ModePoints, ...],
    amplitudes: Float[np.ndarray, "g k r"],
    found: Bool[np.ndarray, "g k"],
    *,
    tolerance: float,
    most: int,
    rows: int = 700,
) -> Sampling:
    """The cubature of all points that the states of these amplitudes (g, k, r) of the modes ask for.

    Those `found` (g, k) count; the states of a group are so near each other that the tangent at its first, if
    that was found, is theirs. `tolerance` [-]: of the states' amplitudes, the root mean square that may be
    missed; `most` points; `rows`: to so many the training values are compressed. Raises SolveError when a
    state is at rest, or none strains the body.
    """
    size = np.linalg.norm(amplitudes, axis=2)
    if not np.all(size[found] > 0):
        state = int(np.argmin(size[found]))
        raise SolveError(f"training state {state} is the body at rest: give states under load")
    each = list(_work(points, amplitudes, found))
    counted = np.sqrt(_COMBINATIONS * len(each)) * size[found[:, :1] & found]
    whole, beyond = (
        np.concatenate([row / by for row, by in zip(rows_of, counted, strict=True)])
        for rows_of in zip(*((work.whole, work.whole - work.of_rest) for work in each), strict=True)
    )
    beyond_rest = bool(np.linalg.norm(beyond) < np.linalg.norm(whole))
    values = compressed(beyond if beyond_rest else whole, rows)
    total = float(np.linalg.norm(values.sum(axis=1)))
    cubature = empirical_cubature(values, tolerance=tolerance / total if total else 0.0, most=most)
    return Sampling(cubature._replace(error=cubature.error * total), beyond_rest)


def _work(
    points: tuple[ModePoints, ...], amplitudes: Float[np.ndarray, "g k r"], found: Bool[np.ndarray, "g k"]
) -> Iterator[Work]:
    """Of each state that counts: every point's work (c, q) along c random K(z)⁻¹ ξ."""
    random = np.random.default_rng(0)
    for group, known in zip(amplitudes, found, strict=True):
        if not known[0]:
            continue
        tangent = np.asarray(_tangent(points, jnp.asarray(group[0])), float)
        for z in group[known]:
            along = jnp.asarray(np.linalg.solve(tangent, random.normal(size=(len(z), _COMBINATIONS))))
            parts = [_point_work(each, jnp.asarray(z), along) for each in points]
            yield Work(*(np.concatenate(part, axis=1) for part in zip(*parts, strict=True)))


@eqx.filter_jit
def _tangent(points: tuple[ModePoints, ...], z: Float[Array, " n"]) -> Float[Array, "n n"]:
    # It says what matters how much, for which single precision does.
    return sum((each.single().tangent(z) for each in points), start=jnp.zeros(()))


@eqx.filter_jit
def _point_work(points: ModePoints, z: Float[Array, " n"], along: Float[Array, "n c"]) -> Work:
    return points.work(z, along)
