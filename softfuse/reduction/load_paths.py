"""Where a reduced body is taught: loads raised at some places, and what is near each of their equilibria."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from softfuse.reduction.cells import Cell, pairs

_BEYOND = 1.15
"""The part of a cell around each place is enlarged by so much for what is near, so that parts overlap."""


class LoadPath(NamedTuple):
    """Loads at a `place` (c, ...), their drives raised from rest through `levels` (l, D); and at each level k
    other places (l, k, c, ...) and drives (l, k, D), near enough for one Newton step.
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
