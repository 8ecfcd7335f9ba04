"""At which points a reduced body measures its energy: a cubature of what is beyond the linear part.

In a state z a quadrature point does work on the modes beyond what its tangent at rest says. Points and
weights are chosen such that the sums over the chosen ones are those over all, for all training states and
modes, each state counted by its size.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import SolveError
from softfuse.reduction.cubature import Cubature, compressed, empirical_cubature
from softfuse.reduction.mode_points import ModePoints

_STATES_AT_ONCE = 8


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
    values = []
    for first in range(0, len(amplitudes), _STATES_AT_ONCE):
        some = [
            np.concatenate([np.asarray(_beyond_rest(each, jnp.asarray(z))) for each in points], axis=1)
            / np.linalg.norm(z)
            for z in amplitudes[first : first + _STATES_AT_ONCE]
        ]
        # Sketches of the parts side by side are a sketch of all.
        values.append(compressed(np.concatenate(some), rows, seed=first))
    return empirical_cubature(
        compressed(np.concatenate(values), rows, seed=-1 % 2**31), tolerance=tolerance, most=most
    )


@eqx.filter_jit
def _beyond_rest(points: ModePoints, z: Float[Array, " n"]) -> Float[Array, "n k"]:
    return points.beyond_rest(z)
