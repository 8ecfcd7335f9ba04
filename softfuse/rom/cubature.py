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

_RIDGE = 1e-13
"""Added to the parts' products with each other, of their mean square."""


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
    parts = np.ascontiguousarray(values.T)
    taken, weights, gram = np.zeros(0, int), np.zeros(0), np.zeros((0, 0))
    left, error, wanted = total, 1.0, 1
    while error > tolerance and len(taken) < most:
        along = parts @ left
        along[taken] = -np.inf
        best = np.argsort(along)[::-1][: min(wanted, most - len(taken))]
        best = best[along[best] > 0]
        if not len(best):
            break
        more, more_gram = np.append(taken, best), _bordered(gram, parts[taken], parts[best])
        at, found = _nonnegative(more_gram, parts[more] @ total, np.append(weights, np.zeros(len(best))))
        still_left = total - found @ parts[more[at]]
        smaller = float(np.linalg.norm(still_left)) / size
        if smaller < error:
            taken, weights, gram = more[at], found, more_gram[np.ix_(at, at)]
            left, error = still_left, smaller
            wanted = min(2 * wanted, max(1, int(at_once * len(taken))))
        elif wanted > 1:
            # Several at once may push each other out; the best by itself always helps.
            wanted = max(1, wanted // 4)
        else:
            break
    return Cubature(taken, weights, error)


def _bordered(
    gram: Float[np.ndarray, "k k"], parts: Float[np.ndarray, "k r"], more: Float[np.ndarray, "m r"]
) -> Float[np.ndarray, "k+m k+m"]:
    """The products of parts (k, r) with each other, and with more (m, r)."""
    across = parts @ more.T
    return np.block([[gram, across], [across.T, more @ more.T]])


def _nonnegative(
    gram: Float[np.ndarray, "k k"], product: Float[np.ndarray, " k"], weights: Float[np.ndarray, " k"]
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Which of k parts to keep, and their weights: least squares from the parts' products with each other and
    with the total, from feasible weights (k,): parts whose weight would fall below 0 go.
    """
    # Two parts may be the same: which of them gets the weight does not matter.
    gram = gram + _RIDGE * np.mean(np.diag(gram)) * np.eye(len(gram))
    at = np.arange(len(gram))
    while True:
        # By the normal equations: weights to some digits are enough, and QR takes fifty times as long.
        factor = scipy.linalg.cho_factor(gram[np.ix_(at, at)], check_finite=False)
        best = scipy.linalg.cho_solve(factor, product[at], check_finite=False)
        if best.min() > 0:
            return at, best
        falling = best <= 0
        # As far as all stay positive; at least one then is 0.
        reach = float(np.min(weights[falling] / (weights[falling] - best[falling])))
        weights = weights + reach * (best - weights)
        kept = weights > 1e-12 * weights.max()
        at, weights = at[kept], weights[kept]
        if not len(at):
            return at, weights
