"""Layouts to begin a search with: random ones, moved to where their walls can be made.

From θ_r, uniform between the bounds, a start is the nearest θ, distances counted in `Parameter.scale`, whose
walls are thick enough and whose shapes exist. Thicknesses are signed distances, so that cavities that overlap
are pushed apart. No robot is needed for that.
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from softfuse.design.problem import Geometry
from softfuse.errors import SoftfuseError
from softfuse.robot.layout.layout import AbstractLayout

_TRIES = 200
"""Random layouts that are tried for each that is wanted."""

_SPARE_M = 1e-5
"""By how much walls are thicker than they must be."""


def random_starts(
    layout: AbstractLayout, geometry: Geometry, count: int, seed: int, *, tries: int = _TRIES
) -> Float[np.ndarray, "count p"]:
    """So many layouts' parameters (count, p) that can be made, of `tries` times as many at most; the same for
    the same seed.

    Raises SoftfuseError when hardly any can.
    """
    rng = np.random.default_rng(seed)
    starts: list[Float[np.ndarray, " p"]] = []
    for _ in range(tries * count):
        if len(starts) == count:
            break
        moved = nearest_that_can_be_made(layout, geometry, rng.uniform(layout.lower, layout.upper))
        if moved is not None:
            starts.append(moved)
    if len(starts) < count:
        raise SoftfuseError(
            f"only {len(starts)} of {tries * count} random layouts could be moved to where their walls are "
            "thick enough: narrow the parameters' bounds, or make walls thinner"
        )
    return np.array(starts)


def nearest_that_can_be_made(
    layout: AbstractLayout, geometry: Geometry, theta: Float[np.ndarray, " p"]
) -> Float[np.ndarray, " p"] | None:
    """The nearest parameters (p,) with walls that are thick enough, None where none are found."""
    scale = layout.scale
    wanted = theta / scale
    result = minimize(
        lambda x: 0.5 * np.sum((x - wanted) ** 2),
        wanted,
        jac=lambda x: x - wanted,
        bounds=np.stack([layout.lower, layout.upper], axis=1) / scale[:, None],
        constraints={
            "type": "ineq",
            "fun": lambda x: 1e3 * (geometry.spare(x * scale) - _SPARE_M),
            "jac": lambda x: 1e3 * geometry.slope(x * scale) * scale,
        },
        method="SLSQP",
        options={"maxiter": 50},
    )
    found = np.clip(result.x * scale, layout.lower, layout.upper)
    spare = geometry.spare(found)
    return found if np.isfinite(spare).all() and spare.min() >= 0.0 else None
