"""Where a reduced body is taught: loads raised at some places, and what is near each of their equilibria."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from softfuse.rom.cells import Cell, pairs

_BEYOND = 1.15
"""The part of a cell around each place is enlarged by so much for what is near, so that parts overlap."""


class LoadPath(NamedTuple):
    """Loads at a `place` (c, 3, 3), their drives raised from rest through `levels` (l, D); and at each level
    k other places (l, k, c, 3, 3) and drives (l, k, D), near enough for one Newton step.
    """

    place: Array
    levels: Float[np.ndarray, "l D"]
    near_places: Array
    near_drives: Float[np.ndarray, "l k D"]


def presses(
    cell: Cell, largest: float, *, side: int = 3, levels: int = 4, near: int = 10, seed: int = 0
) -> list[LoadPath]:
    """Presses of one disc in a cell, with forces up to `largest` [N].

    Up to so many `levels` at the middles of `side` x `side` parts of the cell; at each level so many presses
    `near`, spread evenly (Sobol's sequence, the same for the same `seed`) over the place's own part and half
    a level.
    """
    heights = largest * np.arange(1, levels + 1) / levels
    paths = []
    for number, middle in enumerate(pairs((2 * np.arange(side) + 1) / side - 1)):
        # A power of two keeps the sequence balanced, whatever is taken of it.
        power = int(np.ceil(np.log2(levels * near + 1)))
        spread = 2 * qmc.Sobol(3, rng=seed + number).random_base2(power)[: levels * near] - 1
        spread = spread.reshape(levels, near, 3)
        beside = cell.at(middle + _BEYOND / side * spread[..., :2])
        force = heights[:, None] + 0.5 * heights[0] * spread[..., 2]
        path = LoadPath(
            jnp.asarray(cell.at(middle))[None],
            heights[:, None],
            jnp.asarray(beside)[:, :, None],
            force[..., None],
        )
        paths.append(path)
    return paths


def pushes(
    place: Array,
    patches: int,
    low: Float[np.ndarray, " D"],
    high: Float[np.ndarray, " D"],
    *,
    levels: int = 4,
    near: int = 10,
    seed: int = 0,
) -> list[LoadPath]:
    """Pushes of one contact (1, 3, 3) on so many `patches` while actuators pull, drives up to `high` (D,).

    The contact's whole force is on one patch, or even on all, or there is none; the other drives stay as
    `low` (D,) has them, or one of them is half or all the way up, or all are. All go up together, in so many
    `levels`; at each so many states `near`, each drive within half a level (Sobol's sequence).
    """
    span = high - low
    others = np.flatnonzero(span[patches:] > 0) + patches
    splits = [*np.eye(patches), np.full(patches, 1 / patches), np.zeros(patches)]
    pulls = [np.zeros(len(others)), *(part * row for row in _ones(len(others)) for part in (0.5, 1.0))]
    ends = np.zeros((len(splits), len(pulls), len(low)))
    ends[:, :, :patches] = np.array(splits)[:, None]
    ends[:, :, others] = np.array(pulls)
    ends = np.unique(ends.reshape(-1, len(low)), axis=0)
    heights = np.arange(1, levels + 1)[:, None] / levels
    paths = []
    for number, end in enumerate(ends[np.any(ends > 0, axis=1)]):
        power = int(np.ceil(np.log2(levels * near + 1)))
        spread = qmc.Sobol(len(low), rng=seed + number).random_base2(power)[: levels * near] - 0.5
        beside = (heights * end)[:, None] + spread.reshape(levels, near, -1) / levels
        drives = low + span * np.clip(beside, 0.0, 1.0)
        places = jnp.broadcast_to(place, (levels, near, *place.shape))
        paths.append(LoadPath(place, low + span * heights * end, places, drives))
    return paths


def _ones(count: int) -> Float[np.ndarray, "r k"]:
    """Each of so many alone, and all together."""
    return np.unique(np.concatenate([np.eye(count), np.ones((1, count))]), axis=0) if count else np.eye(0)
