"""By how much a device's readings are uncertain because its parameters are.

Parameters of covariance C = B Bᵀ, on which readings depend with slopes J (k, p), make them uncertain by A Aᵀ,
A = J B. It is known on a grid of places, over the force there, and taken to be linear in the force and
between the places: contacts (c,) with forces F_c at places p_c have A = Σ_c F_c a(p_c), since all depend on
the same parameters.
"""

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from softfuse.errors import SoftfuseError


@dataclass(frozen=True, eq=False)
class ReadingSpread:
    """Of one contact at each place of a grid of x (a,) and y (b,) [m], over its force: `by_parameters`
    (a, b, k, p): A [1/N]; readings in SI.
    """

    x_m: Float[np.ndarray, " a"]
    y_m: Float[np.ndarray, " b"]
    by_parameters: Float[np.ndarray, "a b k p"]

    def covariance(
        self,
        places: Float[np.ndarray, "c 3 3"],
        force_N: Float[np.ndarray, " c"],
    ) -> Float[np.ndarray, "k k"]:
        """Covariance (k, k) of readings under contacts at places (c, 3, 3) with forces (c,) N; beyond the
        grid that of its border.
        """
        share, i, j = self._corners(places)
        a = np.einsum("qc,qckp->kp", share * force_N, self.by_parameters[i, j])
        return a @ a.T

    def _corners(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The four corners of the cells that places (c, 3, 3) are in: their shares and numbers (4, c)."""
        (i, s), (j, t) = (_between(grid, places[:, 0, k]) for k, grid in enumerate((self.x_m, self.y_m)))
        share = np.stack([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
        return share, np.stack([i, i + 1, i, i + 1]), np.stack([j, j, j + 1, j + 1])


def _between(grid: Float[np.ndarray, " g"], at: Float[np.ndarray, " c"]) -> tuple[np.ndarray, np.ndarray]:
    """The interval (c,) of a grid that places are in, and how far along it (c,), 0 to 1."""
    inside = np.clip(at, grid[0], grid[-1])
    k = np.clip(np.searchsorted(grid, inside, side="right") - 1, 0, len(grid) - 2)
    return k, (inside - grid[k]) / (grid[k + 1] - grid[k])


_ARRAYS = ("x_m", "y_m", "by_parameters")


def write_spread(path: Path, spread: ReadingSpread, **others: np.ndarray) -> None:
    """Write a spread, and arrays that it comes from, as a file of arrays (.npz)."""
    with path.open("wb") as stream:
        arrays: Any = {name: getattr(spread, name) for name in _ARRAYS} | others
        np.savez_compressed(stream, **arrays)


def read_spread(path: Path, readings: int) -> ReadingSpread:
    """The spread in a file, of a device with so many readings.

    Raises SoftfuseError, which names the file, when it holds none, or another device's.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            x, y, by_parameters = (np.asarray(arrays[name], float) for name in _ARRAYS)
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise SoftfuseError(f"{path}: holds no spread of readings: calibrate again ({error})") from error
    grid = (len(x), len(y), readings)
    shaped = by_parameters.shape[:3] == grid and by_parameters.ndim == 4
    whole = all(np.isfinite(each).all() for each in (x, y, by_parameters))
    if not (shaped and whole and min(len(x), len(y)) >= 2):
        raise SoftfuseError(f"{path}: no spread of {readings} readings over a grid: calibrate again")
    return ReadingSpread(x, y, by_parameters)
