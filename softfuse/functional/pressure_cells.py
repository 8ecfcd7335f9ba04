"""How a contact's force may be distributed: cells of the unit disc, of fixed shape of pressure, unit force.

`uniform` has one cell, constant pressure on the whole disc: "equal force everywhere" (Navarro et al. 2020,
Sec. IV-B), whose functional is the patch's mean displacement. `even` has several, each under constant
pressure, for contacts whose own extent is unknown, and `strip` the same on a rectangle. `flat_punch` cuts the
disc into ring sectors; the forces of the cells then follow from equal displacement where pressed and no
tension. The pressure under a sharp rigid edge grows like (1 − r²)^(-1/2), so every cell carries this weight:
on an elastic half space equal cell pressures are then the exact solution. Quadrature in s = √(1 − r²) takes
the singularity out, ∫ f r dr / √(1 − r²) = ∫ f ds. Source: Johnson, Contact Mechanics, 1985, ch. 3.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


class PressureCells(eqx.Module):
    """Quadrature points (p, 2) on the unit disc, the number (p,) of the cell that each belongs to, the share
    (p,) of that cell's force that acts there, the cells' areas (m,), of a disc π together, and their `count`
    m; the shares of a cell sum to 1.
    """

    points: Float[Array, "p 2"]
    cell: Int[Array, " p"]
    share: Float[Array, " p"]
    area: Float[Array, " m"]
    count: int = eqx.field(static=True)


def uniform(*, rings: int = 10, angles: int = 32) -> PressureCells:
    """Constant pressure on the disc, at rings × angles quadrature points."""
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radius = np.sqrt(0.5 * (nodes + 1))  # r² is uniform over the disc's area
    turn = 2 * np.pi / angles * (np.arange(angles) + 0.5 * (np.arange(rings) % 2)[:, None])
    points = radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    share = np.repeat(weights / weights.sum() / angles, angles)
    cell = jnp.zeros(len(share), jnp.int32)
    return PressureCells(jnp.asarray(points.reshape(-1, 2)), cell, jnp.asarray(share), jnp.full(1, np.pi), 1)


def flat_punch(
    rims: tuple[float, ...] = (0.45, 0.75, 0.93, 1.0),
    sectors: tuple[int, ...] = (4, 8, 12, 12),
    *,
    points: int = 3,
) -> PressureCells:
    """Ring sectors between the radii 0, `rims`..., each ring cut into its number of `sectors`, with points²
    quadrature points a cell.
    """

    def radius(inner: float, rim: float, part: Float[np.ndarray, " q"]) -> Float[np.ndarray, " q"]:
        depth = np.sqrt(1 - inner**2) + (np.sqrt(1 - rim**2) - np.sqrt(1 - inner**2)) * part
        return np.sqrt(1 - depth**2)

    return _ring_sectors(rims, sectors, points, radius)


def even(
    rims: tuple[float, ...] = (0.15, 0.3, 0.45, 0.6, 0.8, 1.0),
    sectors: tuple[int, ...] = (4, 6, 6, 8, 8, 8),
    *,
    points: int = 3,
) -> PressureCells:
    """Ring sectors as of `flat_punch`, each under constant pressure."""
    return _ring_sectors(
        rims, sectors, points, lambda inner, rim, part: np.sqrt(inner**2 + (rim**2 - inner**2) * part)
    )


def strip(half_width: float, along: int, across: int, *, points: int = 3) -> PressureCells:
    """A rectangle from (−1, −half_width) to (1, half_width), cut into `along` x `across` equal cells, each
    under constant pressure, with points² quadrature points a cell.
    """
    nodes, weights = np.polynomial.legendre.leggauss(points)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    first, second = (2 * (np.arange(n)[:, None] + nodes) / n - 1 for n in (along, across))
    grid = np.broadcast_arrays(first[:, None, :, None], half_width * second[None, :, None, :])
    share, count = np.outer(weights, weights).ravel(), along * across
    return PressureCells(
        jnp.asarray(np.stack(grid, axis=-1).reshape(-1, 2)),
        jnp.asarray(np.repeat(np.arange(count, dtype=np.int32), len(share))),
        jnp.asarray(np.tile(share, count)),
        jnp.full(count, 4 * half_width / count),
        count,
    )


def _ring_sectors(
    rims: tuple[float, ...],
    sectors: tuple[int, ...],
    points: int,
    radius_at: Callable[[float, float, Float[np.ndarray, " q"]], Float[np.ndarray, " q"]],
) -> PressureCells:
    """Cells between rims, with Gauss points in the part 0 to 1 of a ring's weight that `radius_at` tells."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    where, areas, inner = [], [], 0.0
    for rim, count in zip(rims, sectors, strict=True):
        radius = radius_at(inner, rim, nodes)
        for k in range(count):
            turn = 2 * np.pi / count * (k + nodes)
            where.append(radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1))
        areas += [np.pi / count * (rim**2 - inner**2)] * count
        inner = rim
    share, count = np.outer(weights, weights).ravel(), len(where)
    return PressureCells(
        jnp.asarray(np.concatenate([w.reshape(-1, 2) for w in where])),
        jnp.asarray(np.repeat(np.arange(count, dtype=np.int32), len(share))),
        jnp.asarray(np.tile(share, count)),
        jnp.asarray(areas),
        count,
    )
