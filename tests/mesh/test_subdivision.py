"""Quadratic tetrahedra cut into smaller ones keep their volume, their neighbours and their curves."""

import numpy as np
import pytest

from softfuse.mesh.orientation import check
from softfuse.mesh.subdivision import refined, subdivided
from softfuse.mesh.surface import cavities
from softfuse.mesh.tetmesh import TetMesh, edge_lengths, quadratic, tet_mesh, volumes

ONE = tet_mesh([[0.0, 0, 0], [1, 0, 0], [0.2, 1, 0], [0, 0.1, 0.7]], [[0, 1, 2, 3]], region=[3])


def test_a_subdivided_tetrahedron_is_three_times_eight_of_equal_volume() -> None:
    np.testing.assert_allclose(volumes(subdivided(quadratic(ONE))), np.full(24, volumes(ONE) / 8), rtol=1e-12)


def test_a_refined_tetrahedron_is_eight_of_equal_volume_in_its_region() -> None:
    mesh = refined(quadratic(ONE))
    np.testing.assert_allclose(volumes(mesh), np.full(8, volumes(ONE) / 8), rtol=1e-12)
    assert mesh.region.tolist() == [3] * 8


def warped(mesh: TetMesh) -> TetMesh:
    x, y, z = mesh.nodes.T
    more = np.stack([3.0 * x * y, 2.0 * z**2 - x * z, 4.0 * x**2 + y * z], axis=1)
    return tet_mesh(mesh.nodes + more, mesh.tets, region=mesh.region)


def test_a_refined_mesh_has_the_curves_and_cavities_of_the_mesh(pad: TetMesh) -> None:
    # Quadratic tetrahedra follow a quadratic map exactly, so refining and warping may change places.
    mesh = warped(quadratic(pad))
    fine = refined(mesh)
    check(fine)
    np.testing.assert_allclose(fine.nodes, warped(refined(quadratic(pad))).nodes, atol=1e-16)
    np.testing.assert_array_equal(fine.nodes[: len(mesh.nodes)], mesh.nodes)
    assert fine.n_corners == len(mesh.nodes) and len(cavities(fine)) == 4
    assert edge_lengths(fine).mean() == pytest.approx(0.5 * edge_lengths(mesh).mean(), rel=0.1)
