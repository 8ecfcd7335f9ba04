"""A body's tangent at rest, K₀ = [[A, B], [Bᵀ, −C]]: what its modes are orthonormal in."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.equilibrium.assembly import assemble, full_pattern
from softfuse.equilibrium.linear_solver import AbstractLinearSolver

_AT_ONCE = 64  # right-hand sides


class RestStiffness(NamedTuple):
    """K₀ (n, n), the stiffness A (u, u) of the u displacements, and the compressibility C (c, c)."""

    whole: scipy.sparse.csc_array
    displacement: scipy.sparse.csc_array
    pressure: scipy.sparse.csc_array
    n_displacements: int


def rest_stiffness(body: Body) -> RestStiffness:
    """The tangent of a body at rest, assembled."""
    pattern = full_pattern(body)
    values = np.asarray(assemble(pattern, tangents(body, jnp.zeros(body.n))))
    places = np.asarray(pattern.rows), np.asarray(pattern.columns)
    whole = scipy.sparse.csc_array((values, places), shape=(body.n, body.n))
    u = body.n_displacements
    return RestStiffness(whole, whole[:u, :u], -whole[u:, u:], u)


def rest_responses(
    linear: AbstractLinearSolver, body: Body, forces: Float[np.ndarray, "n f"]
) -> Float[np.ndarray, "n f"]:
    """K₀⁻¹ forces (n, f): how a body at rest answers to small generalised forces, one a column."""
    factor = eqx.filter_jit(lambda s, b: s.factor(b.element_tangents(jnp.zeros(b.n))))(linear, body)
    solve = eqx.filter_jit(lambda s, f, b: s.solve(f, b))
    n, count = forces.shape
    padded = np.concatenate([forces, np.zeros((n, -count % _AT_ONCE))], axis=1)
    found = [
        np.asarray(solve(linear, factor, jnp.asarray(padded[:, k : k + _AT_ONCE])))
        for k in range(0, padded.shape[1], _AT_ONCE)
    ]
    return np.concatenate([np.zeros((n, 0)), *found], axis=1)[:, :count]


@eqx.filter_jit
def tangents(body: Body, z: Float[Array, " n"]) -> Float[Array, "e d d"]:
    """Element tangents (e, d, d), compiled."""
    return body.element_tangents(z)
