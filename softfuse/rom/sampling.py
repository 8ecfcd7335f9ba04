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
import scipy.linalg
from jaxtyping import Array, Bool, Float, Int

from softfuse.errors import SolveError
from softfuse.rom.mode_points import ModePoints, Work

_RIDGE = 1e-13
"""Added to the parts' products with each other, of their mean square."""

_COMBINATIONS = 4
"""Of the modes, asked for in each state."""


class Cubature(NamedTuple):
    """Parts (k,) that are evaluated, their weights (k,) > 0 [-], and the error left, relative to the sums."""

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

    Of training values G (r, e), one row for each quantity in each training state, a sparse w ≥ 0 (e,) is
    sought with ‖G w − G 1‖ ≤ τ ‖G 1‖. Parts are taken greedily, those most along what is left, and their
    weights are the nonnegative least squares of all that have been taken. Positive weights of an energy's
    parts make an energy: what is reduced stays stable, and forces keep a potential. Source: Farhat, Avery,
    Chapman and Cortial, Int. J. Numer. Meth. Eng. 98(9), 2014 (energy-conserving sampling and weighting);
    Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23.

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
