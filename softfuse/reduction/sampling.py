"""At which points a reduced body measures its energy: a cubature of what is beyond the linear part.

In a state z a quadrature point does work on the modes beyond what its tangent at rest says. Points and
weights are chosen such that the sums over the chosen ones are those over all, for all training states, each
counted by its size. Not every mode is asked for in every state but a few random combinations of all, new ones
for each: a Gaussian sketch, which keeps the norm of what is missed (see `compressed`).
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import SolveError
from softfuse.reduction.cubature import Cubature, compressed, empirical_cubature
from softfuse.reduction.mode_points import ModePoints

_COMBINATIONS = 4
"""Of the modes, asked for in each state."""


def sampled(
    points: tuple[ModePoints, ...],
    amplitudes: Float[np.ndarray, "t r"],
    *,
    tolerance: float,
    most: int,
    rows: int = 700,
) -> Cubature:
    """The cubature of all points that the states of these amplitudes (t, r) of the modes ask for.

    `tolerance`, `most`: see `empirical_cubature`; `rows`: to so many the training values are compressed.
    Raises SolveError when a state is at rest, or none strains the body beyond its linear part.
    """
    size = np.linalg.norm(amplitudes, axis=1)
    if not np.all(size > 0):
        raise SolveError(f"training state {int(np.argmin(size))} is the body at rest: give states under load")
    random = np.random.default_rng(0)
    values = []
    for z, length in zip(amplitudes, size, strict=True):
        along = random.normal(size=(amplitudes.shape[1], _COMBINATIONS)) / np.sqrt(_COMBINATIONS)
        work = [np.asarray(_beyond_rest(each, jnp.asarray(z), jnp.asarray(along))) for each in points]
        values.append(np.concatenate(work, axis=1) / length)
    return empirical_cubature(compressed(np.concatenate(values), rows), tolerance=tolerance, most=most)


@eqx.filter_jit
def _beyond_rest(
    points: ModePoints, z: Float[Array, " n"], along: Float[Array, "n c"]
) -> Float[Array, "c k"]:
    return points.beyond_rest(z, along)
