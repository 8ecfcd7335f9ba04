"""Modes of snapshots: orthonormal, best, and honest about what they leave out."""

import numpy as np
import pytest

from softfuse.rom.basis import proper_modes


@pytest.fixture
def spread() -> tuple[np.ndarray, np.ndarray]:
    """Snapshots (30, 80) of falling size in 12 directions, and an inner product's matrix (80, 80)."""
    random = np.random.default_rng(5)
    factors = random.normal(size=(30, 12)) * 0.3 ** np.arange(12)
    root = random.normal(size=(80, 80)) / 9 + np.eye(80)
    return factors @ random.normal(size=(12, 80)), root @ root.T


def test_modes_are_orthonormal_in_the_inner_product(spread) -> None:
    snapshots, matrix = spread
    modes = proper_modes(snapshots, lambda x: matrix @ x, most=12)
    np.testing.assert_allclose(modes.T @ matrix @ modes, np.eye(modes.shape[1]), atol=1e-10)


@pytest.mark.parametrize("most", [1, 4, 7])
def test_what_they_leave_out_is_the_tail_of_the_energies_and_the_least_there_is(spread, most) -> None:
    snapshots, matrix = spread
    found = proper_modes(snapshots, lambda x: matrix @ x, most=most)
    left = snapshots - snapshots @ matrix @ found @ found.T
    energy = np.einsum("sn,nm,sm->", left, matrix, left)
    energies = np.linalg.eigvalsh(snapshots @ matrix @ snapshots.T)[::-1]
    np.testing.assert_allclose(energy, energies[most:].sum(), rtol=1e-8)
    # Eckart and Young: of X M^½ no subspace of that dimension leaves less.
    values = np.linalg.svd(snapshots @ np.linalg.cholesky(matrix), compute_uv=False)
    np.testing.assert_allclose(energy, np.sum(values[most:] ** 2), rtol=1e-8)


def test_no_more_modes_than_the_snapshots_span(spread) -> None:
    snapshots, matrix = spread
    assert proper_modes(snapshots[:, :], lambda x: matrix @ x, most=30).shape == (80, 12)
