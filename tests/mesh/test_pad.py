"""The parametric pad: exact volumes, conforming and symmetric refinement of bounded quality."""

import time
from dataclasses import replace

import numpy as np
import pytest
from checks import unchecked

from softfuse.errors import MeshError
from softfuse.mesh.bisection import TaggedTets, bisected
from softfuse.mesh.block import block_mesh
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.morph import moved_cavities, reshaped_cavities, wall_fields
from softfuse.mesh.orientation import check, oriented
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.quality import mean_ratios
from softfuse.mesh.surface import boundary_faces, cavities, centroid, enclosed_volume, outer_surface
from softfuse.mesh.tetmesh import TetMesh, edge_lengths, nodal_jacobians, quadratic, tet_mesh, volumes

SIZES = [
    (0.1, 0.028, 0.0),
    (0.016, 0.014, 0.0),
    (0.014, 0.014, 0.006),
    (0.0067, 0.0095, 0.0),
    (0.009, 0.03, 0.0),
]


@pytest.mark.parametrize("sizes", SIZES)
def test_volume_and_cavities_are_exact(geometry: PadGeometry, sizes: tuple[float, float, float]) -> None:
    mesh = pad_mesh(geometry, sizes[0], sizes[1], fine_depth=sizes[2])
    check(mesh)
    assert volumes(mesh).sum() == pytest.approx(80 * 80 * 18e-9 - 4 * 28 * 28 * 6e-9, rel=1e-12)
    assert geometry.block().volume() == pytest.approx(volumes(mesh).sum(), rel=1e-12)
    found = cavities(mesh, geometry.centres())
    assert [1e9 * enclosed_volume(mesh.nodes, c.faces) for c in found] == pytest.approx(
        [4704.0] * 4, rel=1e-12
    )
    for part, centre in zip(found, geometry.centres(), strict=True):
        np.testing.assert_allclose(centroid(mesh.nodes, part.faces), centre, atol=1e-12)
    assert enclosed_volume(mesh.nodes, outer_surface(mesh).faces) == pytest.approx(80 * 80 * 18e-9, rel=1e-12)


@pytest.mark.parametrize("sizes", SIZES)
def test_no_face_hangs_inside(geometry: PadGeometry, sizes: tuple[float, float, float]) -> None:
    """A hanging node would leave faces of one tetrahedron that are on no plane of the pad."""
    mesh = pad_mesh(geometry, sizes[0], sizes[1], fine_depth=sizes[2])
    middles = mesh.nodes[boundary_faces(mesh).faces].mean(axis=1)
    outer = (np.abs(np.abs(middles[:, :2]) - 0.04) < 1e-9).any(axis=1)
    outer |= np.abs(middles[:, 2] - 0.009) > 0.009 - 1e-9
    local = np.abs(np.abs(middles[:, :2]) - 0.017)
    wall = (np.abs(local - 0.014) < 1e-9).any(axis=1) | (np.abs(np.abs(middles[:, 2] - 0.009) - 0.003) < 1e-9)
    inside = (local < 0.014 + 1e-9).all(axis=1) & (np.abs(middles[:, 2] - 0.009) < 0.003 + 1e-9)
    assert (outer | (wall & inside)).all()


@pytest.mark.parametrize("sizes", SIZES)
def test_the_mesh_has_the_pads_eight_symmetries(
    geometry: PadGeometry, sizes: tuple[float, float, float]
) -> None:
    mesh = pad_mesh(geometry, sizes[0], sizes[1], fine_depth=sizes[2])

    def described(nodes: np.ndarray) -> set[tuple[int, ...]]:
        corners = np.round(nodes * 1e9).astype(int)[mesh.tets]
        return {tuple(np.array(sorted(map(tuple, tet))).ravel().tolist()) for tet in corners.tolist()}

    here = described(mesh.nodes)
    assert described(mesh.nodes * [-1, 1, 1]) == here
    assert described(mesh.nodes[:, [1, 0, 2]]) == here


@pytest.mark.parametrize(
    ("size", "growth", "fine"), [(0.012, 1.0, 0.0), (0.012, 0.5, 0.006), (0.007, 2.0, 0.003)]
)
def test_edges_obey_the_size_function(geometry: PadGeometry, size: float, growth: float, fine: float) -> None:
    mesh = pad_mesh(geometry, size, 0.014, growth=growth, fine_depth=fine)
    depth = 0.018 - mesh.nodes[mesh.tets, 2].max(axis=1)
    allowed = size + growth * np.maximum(depth - fine, 0.0)
    length = edge_lengths(mesh).max(axis=1)
    assert (length <= allowed * (1 + 1e-6)).all()


def test_growth_leaves_the_base_coarse_and_fine_depth_keeps_a_layer_fine(geometry: PadGeometry) -> None:
    even = pad_mesh(geometry, 0.007, 0.014, growth=0.0)
    graded = pad_mesh(geometry, 0.007, 0.014, growth=2.0)
    layer = pad_mesh(geometry, 0.007, 0.014, growth=2.0, fine_depth=0.006)
    assert len(graded.nodes) < 0.7 * len(layer.nodes) < 0.7 * len(even.nodes)
    for mesh, coarsest in ((even, 0.007), (graded, 0.014), (layer, 0.0101)):
        lowest = mesh.nodes[mesh.tets, 2].max(axis=1) < 0.007
        assert edge_lengths(mesh)[lowest].max() >= coarsest * 0.95


def test_quality_stays_bounded_under_refinement(geometry: PadGeometry) -> None:
    lowest = [
        mean_ratios(pad_mesh(geometry, s, 0.014, growth=0.7)).min() for s in (0.02, 0.01, 0.005, 0.0025)
    ]
    assert min(lowest) > 0.25
    assert lowest[3] > 0.9 * lowest[2] > 0.8 * lowest[1]


def test_bisection_around_a_point_is_conforming_and_repeats_its_shapes() -> None:
    axis = np.linspace(0.0, 1.0, 3)
    grid = kuhn_grid((axis, axis, axis), np.ones((2, 2, 2), bool), (0, 0, 0))
    shapes = []
    for _ in range(12):
        near = np.linalg.norm(grid.nodes[grid.tets].mean(axis=1) - [0.3, 0.4, 0.55], axis=1)
        grid = bisected(grid, near < near.min() + 0.05)
        mesh = oriented(tet_mesh(grid.nodes, grid.tets))
        assert volumes(mesh).sum() == pytest.approx(1.0, rel=1e-12)
        assert len(boundary_faces(mesh).faces) == on_the_cube(mesh)
        shapes.append(mean_ratios(mesh).min())
    assert min(shapes) == pytest.approx(shapes[2], rel=1e-9) and len(mesh.tets) > 500


def on_the_cube(mesh: TetMesh) -> int:
    """Boundary faces that lie in one of the six planes of the unit cube."""
    corners = mesh.nodes[boundary_faces(mesh).faces]
    return int(((corners == 0.0).all(axis=1) | (corners == 1.0).all(axis=1)).any(axis=1).sum())


def test_regions_are_inherited_by_both_children() -> None:
    axis = np.linspace(0.0, 1.0, 2)
    grid = kuhn_grid((axis, axis, axis), np.ones((1, 1, 1), bool), (0, 0, 0))
    grid = TaggedTets(grid.nodes, grid.tets, grid.tags, np.arange(6))
    finer = bisected(bisected(grid, np.ones(6, bool)), np.ones(12, bool))
    size = np.abs(volumes(tet_mesh(finer.nodes, finer.tets)))
    np.testing.assert_allclose(np.bincount(finer.region, weights=size), np.full(6, 1 / 6))


@pytest.mark.parametrize(
    ("sizes", "count"),
    [
        ((0.030, 0.028, 0.0, 0.0), 1500),
        ((0.016, 0.014, 1.0, 0.003), 2700),
        ((0.014, 0.014, 1.0, 0.009), 4500),
        ((0.0095, 0.014, 1.0, 0.006), 10_000),
        ((0.0075, 0.014, 1.0, 0.006), 20_000),
    ],
)
def test_parameters_for_the_usual_numbers_of_quadratic_nodes(
    geometry: PadGeometry, sizes: tuple[float, float, float, float], count: int
) -> None:
    surface, base, growth, fine = sizes
    mesh = quadratic(pad_mesh(geometry, surface, base, growth=growth, fine_depth=fine))
    assert len(mesh.nodes) == pytest.approx(count, rel=0.06)


def test_thirty_thousand_tetrahedra_take_less_than_two_seconds(geometry: PadGeometry) -> None:
    start = time.perf_counter()
    mesh = pad_mesh(geometry, 0.0035, 0.014, growth=1.0)
    assert time.perf_counter() - start < 2.0 and len(mesh.tets) > 30_000


def test_a_size_of_ones_own_refines_around_a_contact(geometry: PadGeometry) -> None:
    def longest(corners: np.ndarray) -> np.ndarray:
        return 0.002 + np.linalg.norm(corners - [0.01, -0.006, 0.018], axis=2).min(axis=1)

    mesh = block_mesh(geometry.block(), 0.014, longest)
    check(mesh)
    assert (edge_lengths(mesh).max(axis=1) <= longest(mesh.nodes[mesh.tets]) * (1 + 1e-6)).all()
    assert len(mesh.nodes) < 1500


def test_a_pad_without_cavities_and_one_off_centre() -> None:
    solid = PadGeometry((0.06, 0.04, 0.02), (0.01, 0.01, 0.01), (), 0.005)
    assert volumes(pad_mesh(solid, 0.02, 0.02)).sum() == pytest.approx(0.06 * 0.04 * 0.02)
    one = replace(solid, cavity_centres=((0.011, -0.003),))
    mesh = pad_mesh(one, 0.02, 0.02)
    assert volumes(mesh).sum() == pytest.approx(one.block().volume(), rel=1e-12)
    assert len(cavities(mesh, one.centres())) == 1


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"cavity_centres": ((0.03, 0.0),)}, "cavity 0 .* reaches the surface"),
        ({"cavity_z_bottom": 0.0}, "reaches the surface"),
        ({"cavity_centres": ((0.0, 0.0), (0.02, 0.02))}, "cavities 0 and 1 touch"),
        ({"cavity_centres": ((-0.017, 0.0), (-0.0168, 0.03))}, "reaches|touch"),
        ({"cavity_centres": ((-0.017, -0.017), (0.0171, 0.017), (0.017, -0.017))}, "0.1 mm apart .* align"),
        ({"size": (0.08, -0.08, 0.018)}, "must be positive"),
    ],
)
def test_an_impossible_pad_is_told(geometry: PadGeometry, change: dict, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        pad_mesh(replace(geometry, **change), 0.014, 0.014)


def test_a_size_that_is_not_positive_is_told(geometry: PadGeometry) -> None:
    with pytest.raises(MeshError, match="surface_size must be positive"):
        pad_mesh(geometry, 0.0, 0.014)


@pytest.mark.parametrize("order", [1, 2])
def test_cavities_move_and_the_mesh_follows(geometry: PadGeometry, pad: TetMesh, order: int) -> None:
    shifts = 5e-4 * np.array([[1.0, 0, 0], [0, -1.0, 0.5], [0.3, 0.4, -1.0], [0, 0, 0]])
    before = pad if order == 1 else quadratic(pad)
    after = moved_cavities(before, shifts, centres=geometry.centres())
    np.testing.assert_array_equal(after.tets, before.tets)
    walls = cavities(after, geometry.centres() + shifts)
    for wall, centre in zip(walls, geometry.centres() + shifts, strict=True):
        np.testing.assert_allclose(centroid(after.nodes, wall.faces), centre, atol=1e-12)
        assert enclosed_volume(after.nodes, wall.faces) == pytest.approx(4704e-9, rel=1e-9)
    skin = outer_surface(before).faces
    np.testing.assert_allclose(after.nodes[skin], before.nodes[skin], atol=1e-15)
    assert volumes(after).sum() == pytest.approx(geometry.block().volume(), rel=1e-9)


def test_cavities_are_resized_about_their_middles(geometry: PadGeometry, pad: TetMesh) -> None:
    shifts = 5e-4 * np.array([[1.0, 0, 0], [0, -1.0, 0.5], [0.3, 0.4, -1.0], [0, 0, 0]])
    growths = 3e-4 * np.array([[1.0, 0, 0], [0, -1.0, 0.5], [0.3, 0.4, -1.0], [0, 0, 1.0]])
    after = reshaped_cavities(pad, shifts, growths, centres=geometry.centres())
    sizes = np.array([28e-3, 28e-3, 6e-3]) + growths
    walls = cavities(after, geometry.centres() + shifts)
    for wall, centre, size in zip(walls, geometry.centres() + shifts, sizes, strict=True):
        nodes = after.nodes[np.unique(wall.faces)]
        np.testing.assert_allclose(nodes.min(axis=0), centre - 0.5 * size, atol=1e-12)
        np.testing.assert_allclose(nodes.max(axis=0), centre + 0.5 * size, atol=1e-12)
        assert enclosed_volume(after.nodes, wall.faces) == pytest.approx(size.prod(), rel=1e-9)
    skin = outer_surface(pad).faces
    np.testing.assert_allclose(after.nodes[skin], pad.nodes[skin], atol=1e-15)
    with unchecked(), pytest.raises(MeshError, match="3 growths are given for 4 cavities"):
        reshaped_cavities(pad, shifts, growths[:3])


def test_curved_edges_become_straighter_where_walls_come_close(geometry: PadGeometry, pad: TetMesh) -> None:
    before = quadratic(pad)
    (wall, *_) = cavities(before, geometry.centres())
    roof = np.unique(wall.faces[:, 3:])
    high = before.nodes[wall.faces[:, :3], 2].max()
    roof = roof[before.nodes[roof, 2] > high - 1e-9]
    bulged = before.nodes.copy()
    bulged[roof, 2] += 0.4e-3  # a roof that edges curve towards the skin
    before = replace(before, nodes=bulged)
    check(before)
    shifts = np.zeros((4, 3))
    shifts[0, 2] = 0.85 * (before.nodes[:, 2].max() - high)
    stiff = before.nodes + np.einsum(
        "ki,kn->ni", shifts, wall_fields(before, centres=geometry.centres())[:, 0]
    )
    assert nodal_jacobians(replace(before, nodes=stiff)).min() < 0
    after = moved_cavities(before, shifts, centres=geometry.centres())
    assert nodal_jacobians(after).min() > 0
    n = before.n_corners
    np.testing.assert_array_equal(after.nodes[:n], stiff[:n])
    as_given = (after.nodes == stiff).all(axis=1)
    assert as_given.mean() > 0.9
    floor = np.unique(cavities(after, geometry.centres() + shifts)[1].faces)
    assert as_given[floor].all()


def test_cavities_moved_too_far_are_told(geometry: PadGeometry, pad: TetMesh) -> None:
    with pytest.raises(MeshError, match="shifted too far"):
        moved_cavities(pad, np.full((4, 3), 0.02), centres=geometry.centres())
    with pytest.raises(MeshError, match="3 shifts are given for 4 cavities"):
        moved_cavities(pad, np.zeros((3, 3)))
