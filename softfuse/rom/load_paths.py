"""What a reduced body is taught with: contacts that press while actuators pull."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from softfuse.rom.cells import Part


class LoadPath(NamedTuple):
    """Loads at a `place` (c, 3, 3), their drives raised from rest through `levels` (l, D); and at each level
    k other places (l, k, c, 3, 3) and drives (l, k, D), near enough for one Newton step.
    """

    place: Array
    levels: Float[np.ndarray, "l D"]
    near_places: Array
    near_drives: Float[np.ndarray, "l k D"]


def load_paths(
    parts: Sequence[Part],
    pushes: int,
    low: Float[np.ndarray, " D"],
    high: Float[np.ndarray, " D"],
    *,
    levels: int = 4,
    near: int = 10,
    seed: int = 0,
) -> list[LoadPath]:
    """Paths of one contact, which pushes with the first so many of the drives between `low` and `high` (D,),
    and of the actuators that have the others; in each part of a region.

    At its end a path is at one of `ends`, through so many `levels`; at each level so many states `near`,
    spread evenly (Sobol's sequence of a `seed`) over the part and half a level of each drive.
    """
    rest = np.clip(0.0, low, high)
    reach = np.maximum(high - rest, rest - low)
    heights = np.arange(1, levels + 1)[:, None] / levels
    # A power of two keeps the sequence balanced, whatever is taken of it.
    power = int(np.ceil(np.log2(levels * near + 1)))
    paths, reached = [], ends(pushes, low, high)
    for number, part in enumerate(parts):
        for end in reached:
            if number and not np.any(end[:pushes]):
                continue  # it is nowhere
            spread = qmc.Sobol(2 + len(low), rng=seed + len(paths)).random_base2(power)[: levels * near]
            aside, more = np.split(2 * spread.reshape(levels, near, -1) - 1, [2], axis=-1)
            drives = rest + (heights * end)[:, None] + 0.5 / levels * reach * more
            paths.append(
                LoadPath(
                    jnp.asarray(part(np.zeros(2)))[None],
                    rest + heights * end,
                    jnp.asarray(part(aside))[:, :, None],
                    np.clip(drives, low, high),
                )
            )
    return paths


def ends(
    pushes: int, low: Float[np.ndarray, " D"], high: Float[np.ndarray, " D"]
) -> Float[np.ndarray, "e D"]:
    """By how much drives (D,) are above what is between their limits nearest to 0, on the ends (e, D) of load
    paths.

    A contact's whole force is on one of its `pushes`, or even on all; those that may be of either sign are
    tried at each limit, beside that. Or there is none. The others stay, or one of them is half or all the way
    at a limit, or all are at their highest.
    """
    rest = np.clip(0.0, low, high)
    limits = np.concatenate([np.diag(high - rest), np.diag(low - rest)])
    of_push = np.any(limits[:, :pushes], axis=1)
    signed = low[:pushes] < 0
    whole = np.diag(np.where(signed, 0.0, high[:pushes]))
    even = whole.sum(axis=0) / max(np.sum(~signed), 1)
    aside = limits[of_push][:, :pushes]
    splits = [*whole, even, 0 * even, *(even + aside[np.any(aside[:, signed], axis=1)])]
    pulls = limits[~of_push & np.any(limits, axis=1)]
    pulls = np.concatenate([pulls, (high - rest)[None]])[:, pushes:]
    ways = [0 * pulls[-1], *0.5 * pulls, *pulls]
    found = np.array([[*split, *way] for split in splits for way in ways])
    found = np.unique(found, axis=0)
    return found[np.any(found != 0, axis=1)]
