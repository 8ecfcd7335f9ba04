"""The modes that a reduced body needs: what its snapshots combine, displacements and pressures apart.

States near many equilibria span what loads between the trained places do as well, so that the proper modes of
all of them need no others beside them: a fifth fewer modes than the body's responses at rest to all forces of
the loads, completed by modes of equilibria, come twice as close to what was not trained (measured on the
reference block).
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.sparse
from jaxtyping import Float

from softfuse.body.body import Body
from softfuse.mechanics.assembly import assemble, full_pattern

Product = Callable[[Float[np.ndarray, "n c"]], Float[np.ndarray, "n c"]]
"""An inner product's matrix M as the map of columns x ↦ M x."""


def proper_modes(
    snapshots: Float[np.ndarray, "s n"], product: Product, *, most: int
) -> Float[np.ndarray, "n m"]:
    """The first `most` modes (n, m) that explain snapshots (s, n) best, fewer where these span less.

    With snapshots as rows X and the inner product M, the eigenvectors v_k, λ_k of the Gram matrix X M Xᵀ give
    the modes Φ_k = Xᵀ v_k / √λ_k, orthonormal in M; the snapshots' mean square distance from the span of the
    first m is Σ_{k>m} λ_k / s, the least there is. Source: Sirovich, Q. Appl. Math. 45(3), 1987.
    Scale the snapshots so that each counts as it should: their squares are summed.
    """
    gram = snapshots @ product(snapshots.T)
    energy, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    energy, vectors = np.maximum(energy[::-1], 0.0), vectors[:, ::-1]
    # Below rounding of the Gram matrix there is nothing but noise.
    kept = min(most, int(np.sum(energy > len(energy) * np.finfo(gram.dtype).eps * energy[:1].sum())))
    modes = snapshots.T @ (vectors[:, :kept] / np.sqrt(energy[:kept]))
    # The Gram matrix squares the condition, so the last modes are orthogonal only roughly.
    return orthonormal(modes, product)


def orthonormal(columns: Float[np.ndarray, "n m"], product: Product) -> Float[np.ndarray, "n m"]:
    """The same span in columns orthonormal in an inner product."""
    factor = np.linalg.cholesky(columns.T @ product(columns))
    return np.linalg.solve(factor, columns.T).T


class RestStiffness(NamedTuple):
    """A body's tangent at rest K₀ = [[A, B], [Bᵀ, −C]] (n, n), the stiffness A (u, u) of the u displacements,
    and the compressibility C (c, c).
    """

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


class Basis(NamedTuple):
    """Displacement modes (u, m), orthonormal in the stiffness A, and pressure modes (c, b), orthonormal in
    the compressibility C, as columns of the full body's unknowns.
    """

    displacement: Float[np.ndarray, "u m"]
    pressure: Float[np.ndarray, "c b"]

    @property
    def columns(self) -> Float[np.ndarray, "n r"]:
        """All m + b modes as columns of z."""
        (u, m), (c, b) = self.displacement.shape, self.pressure.shape
        whole = np.zeros((u + c, m + b))
        whole[:u, :m], whole[u:, m:] = self.displacement, self.pressure
        return whole

    def amplitudes(
        self, states: Float[np.ndarray, "*t n"], stiffness: RestStiffness
    ) -> Float[np.ndarray, "*t r"]:
        """Amplitudes (..., r) of the modes that come closest to full states (..., n), by energy at rest."""
        u = stiffness.n_displacements
        kind = self.displacement.dtype
        moved = (stiffness.displacement @ states[..., :u].T).T.astype(kind) @ self.displacement
        pressed = (stiffness.pressure @ states[..., u:].T).T.astype(kind) @ self.pressure
        return np.concatenate([moved, pressed], axis=-1).astype(float)

    def states(self, amplitudes: Float[np.ndarray, "*t r"]) -> Float[np.ndarray, "*t n"]:
        """States (..., n) of the full body with some amplitudes (..., r) of the modes."""
        # In the precision of the modes: they are much larger than what is multiplied with them.
        of_modes = amplitudes.astype(self.displacement.dtype)
        m = self.displacement.shape[1]
        moved, pressed = of_modes[..., :m] @ self.displacement.T, of_modes[..., m:] @ self.pressure.T
        return np.concatenate([moved, pressed], axis=-1).astype(float)


def basis_of(
    stiffness: RestStiffness, states: Float[np.ndarray, "s n"], *, displacements: int, pressures: int
) -> Basis:
    """So many proper modes of states (s, n), fewer where these span less.

    All states count by their shape, not by their size: each is taken with as much energy at rest.
    """
    u = stiffness.n_displacements
    moves = states[:, :u]
    size = np.sqrt(np.einsum("su,su->s", moves, (stiffness.displacement @ moves.T).T))
    shapes = states / size[:, None]
    moved = proper_modes(shapes[:, :u], lambda x: stiffness.displacement @ x, most=displacements)
    pressed = np.zeros((states.shape[1] - u, 0))
    if pressures and len(pressed):
        pressed = proper_modes(shapes[:, u:], lambda x: stiffness.pressure @ x, most=pressures)
    return Basis(moved, pressed)
