"""Proper orthogonal decomposition: the few modes that explain many snapshots best, in a given inner product.

With snapshots as rows X (s, n) and the inner product M, the eigenvectors v_k, λ_k of the Gram matrix X M Xᵀ
give the modes Φ_k = Xᵀ v_k / √λ_k, orthonormal in M; the snapshots' mean square distance from the span of the
first m is Σ_{k>m} λ_k / s, the least there is. Source: Sirovich, Q. Appl. Math. 45(3), 1987.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Product = Callable[[Float[np.ndarray, "n c"]], Float[np.ndarray, "n c"]]
"""An inner product's matrix M as the map of columns x ↦ M x."""


class Modes(NamedTuple):
    """Modes (n, m), orthonormal in the inner product, and all eigenvalues (s,), largest first."""

    vectors: Float[np.ndarray, "n m"]
    energy: Float[np.ndarray, " s"]


def proper_modes(snapshots: Float[np.ndarray, "s n"], product: Product, *, most: int) -> Modes:
    """The first `most` modes of snapshots (s, n), fewer where these span less.

    Scale the snapshots so that each counts as it should: their squares are summed.
    """
    gram = snapshots @ product(snapshots.T)
    energy, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
    energy, vectors = np.maximum(energy[::-1], 0.0), vectors[:, ::-1]
    # Below rounding of the Gram matrix there is nothing but noise.
    kept = min(most, int(np.sum(energy > len(energy) * np.finfo(gram.dtype).eps * energy[:1].sum())))
    modes = snapshots.T @ (vectors[:, :kept] / np.sqrt(energy[:kept]))
    # The Gram matrix squares the condition, so the last modes are orthogonal only roughly.
    return Modes(orthonormal(modes, product), energy)


def orthonormal(columns: Float[np.ndarray, "n m"], product: Product) -> Float[np.ndarray, "n m"]:
    """The same span in columns orthonormal in an inner product."""
    factor = np.linalg.cholesky(columns.T @ product(columns))
    return np.linalg.solve(factor, columns.T).T
