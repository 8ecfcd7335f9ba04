"""At which elements a reduced body measures its energy: a cubature of what is beyond the linear part.

In a state z the element e does the work Φ_eᵀ (f_e(z) − k_e z_e) on the modes, beyond what its tangent at rest
says. Elements and weights are chosen such that the sums over the chosen ones are those over all, for all
training states and modes, each state counted by its size.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.reduction.basis import Basis
from softfuse.reduction.cubature import Cubature, compressed, empirical_cubature
from softfuse.reduction.rest_stiffness import tangents

_STATES_AT_ONCE = 16


def sampled(
    body: Body,
    basis: Basis,
    amplitudes: Float[np.ndarray, "t r"],
    *,
    tolerance: float,
    most: int,
    rows: int = 700,
) -> Cubature:
    """The cubature that the states of these amplitudes (t, r) of the modes ask for.

    `tolerance`, `most`: see `empirical_cubature`; `rows`: to so many the training values are compressed.
    Raises SolveError when a state is at rest, or none strains the body beyond its linear part.
    """
    size = np.linalg.norm(amplitudes, axis=1)
    if not np.all(size > 0):
        raise SolveError(f"training state {int(np.argmin(size))} is the body at rest: give states under load")
    modes = basis.columns
    parts = isolated(body)
    held = np.concatenate([modes, np.zeros((1, modes.shape[1]))])[np.asarray(body.element_unknowns)]
    own = np.asarray(parts.element_unknowns)
    stiff = tangents(body, jnp.zeros(body.n))

    @jax.jit
    def work(local: Float[Array, "e d"]) -> Float[Array, "e d"]:
        z = jnp.zeros(parts.n).at[own].set(local)
        return parts.residual(z)[own] - jnp.einsum("eab,eb->ea", stiff, local)

    values = []
    for first in range(0, len(amplitudes), _STATES_AT_ONCE):
        some = []
        for k in range(first, min(first + _STATES_AT_ONCE, len(amplitudes))):
            beyond = np.asarray(work(jnp.asarray(held @ amplitudes[k]))) / size[k]
            some.append(np.einsum("edr,ed->re", held, beyond))
        # Sketches of the parts side by side are a sketch of all.
        values.append(compressed(np.concatenate(some), rows, seed=first))
    return empirical_cubature(
        compressed(np.concatenate(values), rows, seed=-1 % 2**31), tolerance=tolerance, most=most
    )


def isolated(body: Body) -> Body:
    """The same elements, each with unknowns of its own and without gravity: `residual` gives every element's
    forces by themselves.
    """
    e, (a, c) = len(body.tets), (body.element.nodes, body.element.pressures)
    moves = np.arange(3 * a * e, dtype=np.int32).reshape(e, a, 3)
    pressures = 3 * a * e + np.arange(c * e, dtype=np.int32).reshape(e, c)
    n = (3 * a + c) * e
    return replace(
        body,
        weight=jnp.zeros(n),
        displacement_unknowns=jnp.asarray(moves.transpose(2, 1, 0)),
        pressure_unknowns=jnp.asarray(pressures.T),
        n_displacements=3 * a * e,
        n=n,
    )
