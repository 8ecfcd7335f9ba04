"""How a body's modes strain it at its quadrature points, at all of them or at a few with other weights."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from softfuse.body.body import Body
from softfuse.body.region import Region, natural_slopes
from softfuse.rom.basis import Basis
from softfuse.rom.mode_points import ModePoints

_AT_ONCE = 1000  # points


def mode_points(
    body: Body,
    basis: Basis,
    numbers: Int[np.ndarray, " c"] | None = None,
    weights: Float[np.ndarray, " c"] | None = None,
) -> tuple[ModePoints, ...]:
    """Quadrature points of a body under the modes of a basis, those of each material together.

    `numbers` (c,): which, counted material by material in the order (q, e) of each; None for all. Their
    volumes are multiplied by `weights` (c,) [-]; what is stiffer than its material, see `ModePoints`.
    """
    count = body.volumes.size
    numbers = np.arange(count) if numbers is None else numbers
    weights = np.ones(len(numbers)) if weights is None else weights
    moves = _followed_by_zeros(basis.displacement, body.n)
    presses = _followed_by_zeros(basis.pressure, body.n - body.n_displacements)
    found, first = [], 0
    for region in body.regions():
        own = (numbers >= first) & (numbers < first + region.volumes.size)
        at = numbers[own] - first
        first += region.volumes.size
        factors = _factors(region, at)
        pieces = [at[k : k + _AT_ONCE] for k in range(0, max(1, len(at)), _AT_ONCE)]
        points = ModePoints.of(
            region.material,
            jnp.asarray(np.concatenate([_gradients(region, moves, each) for each in pieces], axis=1)),
            jnp.asarray(
                np.concatenate([_pressures(region, presses, body.n_displacements, each) for each in pieces])
                / factors[:, None]
            ),
            region.volumes.ravel()[at] * jnp.asarray(weights[own] * factors),
            body.element,
        )
        found.append(points)
    return tuple(found)


def _followed_by_zeros(modes: Float[np.ndarray, "r m"], rows: int) -> Float[np.ndarray, "rows_plus_1 m"]:
    """Modes with rows of zeros behind, the last of which is that of held unknowns."""
    return np.concatenate([modes, np.zeros((rows + 1 - len(modes), modes.shape[1]))])


def _factors(region: Region, at: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """How many times as stiff as its material points `at` (k,) of a region are."""
    if region.factors is None:
        return np.ones(len(at))
    return np.asarray(region.factors)[at % region.volumes.shape[1]]


def _gradients(
    region: Region, moves: Float[np.ndarray, "n_plus_1 m"], at: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "9 k m"]:
    """Displacement gradients (9, k, m) [1/m] of modes at points `at` (k,) of a region."""
    point, element = np.divmod(at, region.volumes.shape[1])
    each = natural_slopes(region.element).reshape(3, -1, region.element.nodes)[:, point]
    nodal = moves[np.asarray(region.displacements)[:, :, element]]
    slopes = np.einsum("nka,iakm->inkm", each, nodal, optimize=True)
    frames = np.asarray(region.frames)[:, :, point, element] / np.asarray(region.volumes)[point, element]
    return np.einsum("inkm,njk->ijkm", slopes, frames, optimize=True).reshape(9, len(at), -1)


def _pressures(
    region: Region, presses: Float[np.ndarray, "c_plus_1 b"], first: int, at: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "k b"]:
    """Pressures (k, b) [Pa] of modes at points `at` (k,), unknowns counted from `first`."""
    count = region.element.pressures
    if not count:
        return np.zeros((len(at), presses.shape[1]))
    point, element = np.divmod(at, region.volumes.shape[1])
    nodal = presses[np.asarray(region.pressures)[:, element] - first]
    return float(region.pressure_unit) * np.einsum(
        "kc,ckb->kb", region.element.points[point][:, :count], nodal
    )
