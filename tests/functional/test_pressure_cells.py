"""Quadrature of the pressure under a disc: unit shares and known moments.

Constant pressure: mean of r² is 1/2, r⁴ 1/3, x⁴ 1/8. Rigid punch, p = (1 − r²)^(-1/2) / 2π: mean of r² is
2/3, r⁴ 8/15, and the half space's surface sinks as arcsin(1/r) outside (Johnson, Contact Mechanics, 1985,
Sec. 3.6).
"""

from math import factorial

import numpy as np
import pytest

from softfuse.functional.pressure_cells import flat_punch, uniform

RIMS, SECTORS = (0.45, 0.75, 0.93, 1.0), (4, 8, 12, 12)


def _disc_moment(i: int, j: int) -> float:
    """Mean of x^i y^j over the unit disc, (2/(i + j + 2)) times that over the circle."""
    if i % 2 or j % 2:
        return 0.0
    a, b = i // 2, j // 2
    circle = factorial(i) * factorial(j) / (4.0 ** (a + b) * factorial(a) * factorial(b) * factorial(a + b))
    return 2.0 / (i + j + 2) * circle


def _heights(rims) -> np.ndarray:
    """s = √(1 − r²) at the centre and at the rims."""
    return np.sqrt(1 - np.array([0.0, *rims]) ** 2)


def _punch_forces(rims, sectors) -> np.ndarray:
    """Each cell's part of the rigid punch's force: its part of the range of s = √(1 − r²)."""
    return np.concatenate([np.full(n, d / n) for n, d in zip(sectors, -np.diff(_heights(rims)), strict=True)])


@pytest.mark.parametrize("cells", [uniform(), uniform(rings=3, angles=7), flat_punch(), flat_punch(points=2)])
def test_every_cell_carries_unit_force_inside_the_disc(cells, shares) -> None:
    assert len(cells.points) == len(cells.share) == len(cells.cell)
    np.testing.assert_allclose(shares(cells).sum(axis=0), 1.0, rtol=1e-13)
    assert np.all(np.asarray(cells.share) >= 0)
    assert np.all(np.linalg.norm(cells.points, axis=1) < 1)


def test_uniform_integrates_polynomials_exactly() -> None:
    cells = uniform()
    x, y = np.asarray(cells.points).T
    share = np.asarray(cells.share)
    for i in range(12):
        for j in range(12 - i):
            np.testing.assert_allclose(share @ (x**i * y**j), _disc_moment(i, j), rtol=0, atol=1e-14)


@pytest.mark.parametrize("rings, angles", [(2, 5), (4, 9)])
def test_uniform_of_few_points_is_exact_to_its_degree(rings, angles) -> None:
    cells = uniform(rings=rings, angles=angles)
    x, y = np.asarray(cells.points).T
    share = np.asarray(cells.share)
    for i in range(angles):
        for j in range(min(angles, 4 * rings) - i):
            np.testing.assert_allclose(share @ (x**i * y**j), _disc_moment(i, j), rtol=0, atol=1e-14)


@pytest.mark.parametrize("rims, sectors", [(RIMS, SECTORS), ((1.0,), (3,)), ((0.3, 0.8, 1.0), (2, 5, 9))])
def test_cells_of_the_rigid_punch_have_its_moments(rims, sectors, shares) -> None:
    cells = flat_punch(rims, sectors)
    force = _punch_forces(rims, sectors)
    assert cells.count == sum(sectors) and np.isclose(force.sum(), 1.0)
    share = shares(cells) @ force
    r2 = np.sum(np.asarray(cells.points) ** 2, axis=1)
    np.testing.assert_allclose([share @ r2, share @ r2**2], [2 / 3, 8 / 15], rtol=1e-13)
    np.testing.assert_allclose(share @ np.asarray(cells.points), 0.0, rtol=0, atol=1e-13)


def test_each_cell_has_the_moments_of_its_own_ring_and_sector(shares) -> None:
    cells = flat_punch(RIMS, SECTORS, points=5)
    points, share = np.asarray(cells.points), shares(cells)
    heights, k = _heights(RIMS), 0
    for ring, count in enumerate(SECTORS):
        top, bottom = heights[ring], heights[ring + 1]
        mean_s2 = (top**3 - bottom**3) / (3 * (top - bottom))
        for sector in range(count):
            own = share[:, k] > 0
            np.testing.assert_allclose(share[:, k] @ np.sum(points**2, axis=1), 1 - mean_s2, rtol=1e-13)
            r = np.linalg.norm(points[own], axis=1)
            assert np.all((r > [0.0, *RIMS][ring]) & (r < RIMS[ring]))
            turn = np.unwrap(np.arctan2(points[own, 1], points[own, 0])) % (2 * np.pi)
            assert np.all((turn > 2 * np.pi * sector / count) & (turn < 2 * np.pi * (sector + 1) / count))
            # Mean of (cos θ, sin θ) over a sector with its middle at φ: sinc(half its angle) (cos φ, sin φ).
            half, middle = np.pi / count, 2 * np.pi * (sector + 0.5) / count
            unit = points[own] / r[:, None]
            expected = np.sin(half) / half * np.array([np.cos(middle), np.sin(middle)])
            np.testing.assert_allclose(share[own, k] @ unit, expected, rtol=0, atol=1e-8)
            k += 1
    assert k == cells.count


def test_rigid_punch_sinks_the_half_space_around_it_as_in_closed_form(shares) -> None:
    cells = flat_punch()
    share = shares(cells) @ _punch_forces(RIMS, SECTORS)
    for r in (1.3, 1.6, 2.5, 4.0):
        for turn in (0.0, 0.4, 1.0):
            at = r * np.array([np.cos(turn), np.sin(turn)])
            sunk = share @ (1 / np.linalg.norm(np.asarray(cells.points) - at, axis=1))
            np.testing.assert_allclose(sunk, np.arcsin(1 / r), rtol=2e-4)


def test_one_number_of_sectors_a_ring() -> None:
    with pytest.raises(ValueError, match="zip"):
        flat_punch((0.5, 1.0), (4, 8, 12))
