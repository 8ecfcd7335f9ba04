"""A body's tangent at rest, K₀ = [[A, B], [Bᵀ, −C]]: what its modes are orthonormal in."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse

from softfuse.body.body import Body
from softfuse.mechanics.assembly import assemble, full_pattern


class RestStiffness(NamedTuple):
    """K₀ (n, n), the stiffness A (u, u) of the u displacements, and the compressibility C (c, c)."""

    whole: scipy.sparse.csc_array
    displacement: scipy.sparse.csc_array
    pressure: scipy.sparse.csc_array
    n_displacements: int


def rest_stiffness(body: Body) -> RestStiffness:
    """The tangent of a body at rest, assembled."""
    pattern = full_pattern(body)
    values = np.asarray(assemble(pattern, eqx.filter_jit(Body.element_tangents)(body, jnp.zeros(body.n))))
    places = np.asarray(pattern.rows), np.asarray(pattern.columns)
    whole = scipy.sparse.csc_array((values, places), shape=(body.n, body.n))
    u = body.n_displacements
    return RestStiffness(whole, whole[:u, :u], -whole[u:, u:], u)
