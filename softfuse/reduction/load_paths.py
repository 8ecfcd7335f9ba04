"""Where a reduced body is taught: loads raised at some places, and what is near each of their equilibria."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

_BEYOND = 1.15
"""Half a place's own square is enlarged by so much for what is near, so that squares overlap."""


class LoadPath(NamedTuple):
    """Loads at a `place` (c, ...), their drives raised from rest through `levels` (l, D); and at each level k
    other places (l, k, c, ...) and drives (l, k, D), near enough for one Newton step.
    """

    place: Array
    levels: Float[np.ndarray, "l D"]
    near_places: Array
    near_drives: Float[np.ndarray, "l k D"]

    @classmethod
    def alone(cls, place: Array, levels: Float[np.ndarray, "l D"]) -> "LoadPath":
        """With nothing near."""
        empty = jnp.zeros((len(levels), 0, *place.shape), place.dtype)
        return cls(place, levels, empty, np.zeros((len(levels), 0, levels.shape[1])))


def pressed_square(
    centre: Float[np.ndarray, "3"],
    across: Float[np.ndarray, "2 3"],
    half: float,
    largest: float,
    *,
    side: int = 3,
    levels: int = 4,
    near: int = 10,
    seed: int = 0,
) -> list[LoadPath]:
    """Presses of one disc in the square of half an edge `half` [m] around `centre` (3,) m, along unit vectors
    (2, 3), with forces up to `largest` [N].

    Up to so many `levels` at the middles of `side` x `side` squares; at each level so many presses `near`,
    spread evenly (Sobol, so the same for the same `seed`) over the place's own square and half a level.
    """
    steps = (2 * np.arange(side) + 1) / side - 1
    heights = largest * np.arange(1, levels + 1) / levels
    paths = []
    for number, (a, b) in enumerate(np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)):
        middle = centre + half * np.array([a, b]) @ across
        # A power of two keeps the sequence balanced, whatever is taken of it.
        spread = 2 * qmc.Sobol(3, rng=seed + number).random_base2(int(np.ceil(np.log2(levels * near + 1))))
        spread = (spread[: levels * near] - 1).reshape(levels, near, 3)
        beside = middle + _BEYOND * half / side * (spread[..., :2] @ across)
        force = heights[:, None] * np.ones(near) + 0.5 * heights[0] * spread[..., 2]
        paths.append(
            LoadPath(
                jnp.asarray(middle)[None], heights[:, None], jnp.asarray(beside)[:, :, None], force[..., None]
            )
        )
    return paths
