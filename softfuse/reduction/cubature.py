"""Empirical cubature: which few parts, with which positive weights, stand for a sum over all of them.

A reduced model needs sums Σ_e g_e over many parts, such as quadrature points, of quantities g_e in few
directions. From training values G (r, e), one row for each quantity in each training state, a sparse w ≥ 0
(e,) is sought with ‖G w − G 1‖ ≤ τ ‖G 1‖. Parts are taken greedily, those most along what is left, and their
weights are the nonnegative least squares of all that have been taken. Positive weights of an energy's parts
make an energy: what is reduced stays stable, and forces keep a potential. Source: Farhat, Avery, Chapman and
Cortial, Int. J. Numer. Meth. Eng. 98(9), 2014 (energy-conserving sampling and weighting); Lawson and Hanson,
Solving Least Squares Problems, 1974, ch. 23.
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from softfuse.errors import SolveError


class Cubature(NamedTuple):
    """Numbers of the parts (k,) that are evaluated, their weights (k,) > 0 [-], and the error that is left,
    relative to the sums.
    """

    parts: Int[np.ndarray, " k"]
    weights: Float[np.ndarray, " k"]
    error: float


def compressed(values: Float[np.ndarray, "r e"], rows: int, seed: int = 0) -> Float[np.ndarray, "k e"]:
    """At most so many rows (k, e) whose products with any weights have, nearly, the norms of all rows'.

    A Gaussian sketch: with k rows, norms keep to about √(2/k). Source: Johnson and Lindenstrauss, 1984.
    """
    if values.shape[0] <= rows:
        return values
    sketch = np.random.default_rng(seed).normal(size=(rows, values.shape[0])) / np.sqrt(rows)
    return sketch @ values


def empirical_cubature(
    values: Float[np.ndarray, "r e"], *, tolerance: float, most: int, at_once: float = 0.05
) -> Cubature:
    """Parts and weights that give the sums over e of values (r, e) to a relative `tolerance`.

    `most`: parts to take at most; `at_once` [-]: a step takes so many more, as a part of those there are.
    Where `most` do not reach the tolerance, the error says so. Raises SolveError when all values are zero, or
    one is not finite.
    """
    total = values.sum(axis=1)
    size = float(np.linalg.norm(total))
    if not (np.isfinite(size) and size > 0):
        raise SolveError("the training states strain no part: give states under load")
    taken, weights, left, error = np.zeros(0, int), np.zeros(0), total, 1.0
    wanted = 1
    while error > tolerance and len(taken) < most:
        along = values.T @ left
        along[taken] = -np.inf
        best = np.argsort(along)[::-1][: min(wanted, most - len(taken))]
        best = best[along[best] > 0]
        if not len(best):
            break
        found = _nonnegative(values, total, np.append(taken, best), np.append(weights, np.zeros(len(best))))
        still_left = total - values[:, found[0]] @ found[1]
        smaller = float(np.linalg.norm(still_left)) / size
        if smaller < error:
            (taken, weights), left, error = found, still_left, smaller
            wanted = max(1, int(at_once * len(taken)))
        elif wanted > 1:
            wanted = 1  # several at once may push each other out; the best by itself always helps
        else:
            break
    return Cubature(taken, weights, error)


def _nonnegative(
    values: Float[np.ndarray, "r e"],
    total: Float[np.ndarray, " r"],
    taken: Int[np.ndarray, " k"],
    weights: Float[np.ndarray, " k"],
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Least squares on the parts taken, from feasible weights: parts whose weight would fall below 0 go."""
    while True:
        # By QR with pivoting: ten times as fast as by singular values.
        found = scipy.linalg.lstsq(values[:, taken], total, lapack_driver="gelsy")
        assert found is not None
        best = found[0]
        if best.min() > 0:
            return taken, best
        falling = best <= 0
        # As far as all stay positive; at least one then is 0.
        reach = float(np.min(weights[falling] / (weights[falling] - best[falling])))
        weights = weights + reach * (best - weights)
        kept = weights > 1e-12 * weights.max()
        if not kept.any():
            return taken[:0], weights[:0]
        taken, weights = taken[kept], weights[kept]
