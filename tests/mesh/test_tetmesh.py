"""Quadratic meshes and the accepted form: what is repaired and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from checks import unchecked
from hypothesis import given, settings
from hypothesis import strategies as st

from softfuse.errors import MeshError
from softfuse.mesh.orientation import check, oriented
from softfuse.mesh.surface import boundary_faces, enclosed_volume
from softfuse.mesh.tetmesh import EDGES, TetMesh, linear, quadratic, tet_mesh, volumes


def test_volume_of_the_unit_tetrahedron() -> None:
    mesh = tet_mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]])
    assert volumes(mesh) == pytest.approx([1 / 6], rel=1e-15)
    assert (mesh.order, mesh.n_corners, mesh.region.tolist()) == (1, 4, [0])


def test_quadratic_nodes_follow_vtk_and_lie_in_the_middle(pad: TetMesh) -> None:
    mesh = quadratic(pad)
    assert mesh.order == 2 and mesh.n_corners == len(pad.nodes)
    ends = mesh.nodes[mesh.tets[:, EDGES]]
    np.testing.assert_allclose(mesh.nodes[mesh.tets[:, 4:]], ends.mean(axis=2), atol=1e-17)
    edges = {tuple(sorted(e)) for e in pad.tets[:, EDGES].reshape(-1, 2).tolist()}
    assert len(mesh.nodes) == len(pad.nodes) + len(edges)
    check(mesh)


def test_linear_undoes_quadratic(pad: TetMesh) -> None:
    back = linear(quadratic(pad))
    np.testing.assert_array_equal(back.nodes, pad.nodes)
    np.testing.assert_array_equal(back.tets, pad.tets)


@pytest.mark.parametrize("order", [1, 2])
def test_a_file_of_the_other_convention_is_repaired(pad: TetMesh, order: int) -> None:
    mesh = pad if order == 1 else quadratic(pad)
    mirrored = replace(mesh, nodes=mesh.nodes * [1.0, 1.0, -1.0])
    assert (volumes(mirrored) < 0.0).all()
    with pytest.raises(MeshError, match=r"tet \d+ has volume -.* flip its nodes"):
        check(mirrored)
    mended = oriented(mirrored)
    np.testing.assert_allclose(volumes(mended), -volumes(mirrored), rtol=1e-12)
    if order == 2:
        ends = mended.nodes[mended.tets[:, EDGES]]
        np.testing.assert_allclose(mended.nodes[mended.tets[:, 4:]], ends.mean(axis=2), atol=1e-17)


@settings(max_examples=30)
@given(st.randoms(use_true_random=False), st.sampled_from([1, 2]))
def test_any_mixture_of_node_orders_is_repaired(random, order: int) -> None:
    cube = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
    mesh = tet_mesh(
        cube, [[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]]
    )
    shuffled = [random.sample(tet, 4) for tet in mesh.tets.tolist()]
    mesh = tet_mesh(cube, shuffled)
    mesh = oriented(mesh if order == 1 else quadratic(mesh))
    assert (volumes(mesh) > 0.0).all() and volumes(mesh).sum() == pytest.approx(1.0)
    assert enclosed_volume(mesh.nodes, boundary_faces(mesh).faces) == pytest.approx(1.0)


def test_a_folded_tetrahedron_is_refused_not_flipped(pad: TetMesh) -> None:
    nodes = pad.nodes.copy()
    inner = np.argmin(np.linalg.norm(nodes - [0.0, 0.0, 0.009], axis=1))
    nodes[inner] += [0.0, 0.0, 0.03]
    with pytest.raises(MeshError, match=r"tets \d+ and \d+ .* overlap"):
        oriented(replace(pad, nodes=nodes))


def test_two_tets_on_one_side_of_their_face_are_refused(two_tets: TetMesh) -> None:
    nodes = two_tets.nodes.copy()
    nodes[4] = [0.1, 0.1, 0.1]
    with pytest.raises(MeshError, match="tets 0 and 1 .* overlap"):
        oriented(replace(two_tets, nodes=nodes))


def test_a_face_of_three_tets_is_refused(two_tets: TetMesh) -> None:
    nodes = np.vstack([two_tets.nodes, [2.0, 2.0, 2.0]])
    mesh = tet_mesh(nodes, [*two_tets.tets.tolist(), [5, 1, 3, 2]])
    with pytest.raises(MeshError, match=r"face \[1, 2, 3\] belongs to the tets \[0, 1, 2\]"):
        oriented(mesh)


def test_unused_nodes_are_dropped_and_the_others_keep_their_order(two_tets: TetMesh) -> None:
    nodes = np.insert(two_tets.nodes, [0, 3], [[9.0, 9, 9], [8.0, 8, 8]], axis=0)
    number = np.array([1, 2, 3, 5, 6])
    mesh = tet_mesh(nodes, number[two_tets.tets])
    with pytest.raises(MeshError, match="no tet uses node 0"):
        check(mesh)
    np.testing.assert_array_equal(oriented(mesh).nodes, two_tets.nodes)
    np.testing.assert_array_equal(oriented(mesh).tets, two_tets.tets)


def test_corner_nodes_are_brought_in_front(two_tets: TetMesh) -> None:
    mesh = quadratic(two_tets)
    order = np.random.default_rng(0).permutation(len(mesh.nodes))
    mixed = tet_mesh(mesh.nodes[order], np.argsort(order)[mesh.tets])
    with pytest.raises(MeshError, match="number the corners first"):
        check(mixed)
    mended = oriented(mixed)
    assert mended.n_corners == 5 and set(mended.corners.ravel()) == set(range(5))
    np.testing.assert_allclose(volumes(mended), volumes(mesh))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_node_that_is_not_finite_is_named(two_tets: TetMesh, value: float) -> None:
    nodes = two_tets.nodes.copy()
    nodes[3, 1] = value
    with pytest.raises(MeshError, match="node 3 has the position"):
        oriented(replace(two_tets, nodes=nodes))


@pytest.mark.parametrize("number", [-1, 5])
def test_a_node_number_out_of_range_is_named(two_tets: TetMesh, number: int) -> None:
    tets = two_tets.tets.copy()
    tets[1, 0] = number
    with pytest.raises(MeshError, match="tet 1 names nodes .* run from 0 to 4"):
        oriented(replace(two_tets, tets=tets))


def test_a_flat_tetrahedron_is_named_with_its_volume(two_tets: TetMesh) -> None:
    nodes = two_tets.nodes.copy()
    nodes[4] = [1 / 3, 1 / 3, 1 / 3 + 1e-9]
    with pytest.raises(MeshError, match=r"tet 1 is flat: volume .* remesh"):
        oriented(replace(two_tets, nodes=nodes))


def test_doubled_nodes_are_refused(two_tets: TetMesh) -> None:
    nodes = np.vstack([two_tets.nodes, two_tets.nodes[1:4]])
    mesh = tet_mesh(nodes, [[0, 1, 2, 3], [4, 5, 7, 6]])
    with pytest.raises(MeshError, match="nodes [123] and [567] are at the same place"):
        oriented(mesh)


def test_a_curved_tetrahedron_that_folds_is_refused() -> None:
    mesh = quadratic(tet_mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2, 3]]))
    nodes = mesh.nodes.copy()
    nodes[4] = [0.6, 0.0, 0.0]
    check(replace(mesh, nodes=nodes))
    nodes[4] = [0.9, 0.0, 0.0]
    with pytest.raises(MeshError, match="curved tet 0 is inverted"):
        check(replace(mesh, nodes=nodes))


def test_wrong_shapes_are_refused(two_tets: TetMesh) -> None:
    for wrong, told in (
        ({"nodes": two_tets.nodes[:, :2]}, r"needs \(n, 3\) coordinates"),
        ({"tets": two_tets.tets[:, :3]}, r"give \(m, 4\) or \(m, 10\)"),
        ({"tets": two_tets.tets[:0], "region": two_tets.region[:0]}, "holds no tetrahedra"),
        ({"region": two_tets.region[:1]}, "one number per tet, 2"),
    ):
        with unchecked(), pytest.raises(MeshError, match=told):
            oriented(replace(two_tets, **wrong))
