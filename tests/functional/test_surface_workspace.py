"""Places on flat, creased and curved surfaces: their frames, and how they are spread."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from softfuse.errors import MeshError
from softfuse.functional.workspace import SurfaceWorkspace, nearest_places
from softfuse.mesh.nearest import nearest_on_triangles
from softfuse.mesh.surface import boundary_faces

RADIUS = 0.03


@pytest.fixture(scope="module")
def sphere() -> tuple[np.ndarray, np.ndarray]:
    """The nodes of a sphere of 30 mm, and its 800 faces or so."""
    k = np.arange(400) + 0.5
    turn, z = np.pi * (1 + 5**0.5) * k, 1 - 2 * k / 400
    nodes = RADIUS * np.column_stack([np.cos(turn) * np.sqrt(1 - z**2), np.sin(turn) * np.sqrt(1 - z**2), z])
    faces = ConvexHull(nodes).simplices
    corners = nodes[faces]
    inwards = np.einsum("fi,fi->f", np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), corners[:, 0]) < 0
    faces[inwards] = faces[inwards][:, [0, 2, 1]]
    return nodes, faces


@pytest.fixture(scope="module")
def block(box) -> tuple[np.ndarray, np.ndarray]:
    mesh = box(*(np.linspace(0, s, n) for s, n in ((0.06, 7), (0.04, 5), (0.02, 3))))
    return mesh.nodes, boundary_faces(mesh).faces


def test_nearest_points_are_those_of_a_dense_sampling(sphere) -> None:
    nodes, faces = sphere
    corners = nodes[faces]
    random = np.random.default_rng(0)
    points = random.normal(size=(40, 3)) * 0.03
    found = nearest_on_triangles(points, corners)
    at = np.einsum("pk,pki->pi", found.barycentric, corners[found.triangle])
    np.testing.assert_allclose(np.linalg.norm(at - points, axis=1), found.distance, rtol=1e-12)
    assert found.barycentric.min() >= 0
    weights = random.dirichlet(np.full(3, 0.6), 300)
    samples = np.einsum("sk,fki->sfi", weights, corners).reshape(-1, 3)
    for point, distance in zip(points, found.distance, strict=True):
        closest = np.linalg.norm(samples - point, axis=1).min()
        assert distance <= closest + 1e-12
        assert closest < distance + 3e-4


def _assert_frames(places: np.ndarray) -> np.ndarray:
    """Unit tangents across each other; the outward normals that they span (p, 3)."""
    u, v = places[:, 1], places[:, 2]
    np.testing.assert_allclose(np.sum(u * v, axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(places[:, 1:], axis=2), 1.0, rtol=1e-12)
    return np.cross(u, v)


def test_flat_sides_have_their_own_direction_up_to_the_edge(block) -> None:
    points = np.array([[0.03, 0.02, 0.03], [0.0599, 0.0001, 0.021], [0.07, 0.01, 0.01], [0.02, -0.01, 0.005]])
    places = nearest_places(*block, points)
    expected = np.array([[0, 0, 1], [0, 0, 1], [1, 0, 0], [0, -1, 0]], float)
    np.testing.assert_allclose(_assert_frames(places), expected, atol=1e-12)
    np.testing.assert_allclose(places[:, 0], np.clip(points, 0, [0.06, 0.04, 0.02]), atol=1e-12)
    np.testing.assert_allclose(places[[0, 1, 3], 1], [[1, 0, 0]] * 3, atol=1e-12)


def test_directions_vary_smoothly_over_a_sphere(sphere) -> None:
    """They are off the exact ones by far less than the facets', and continuous across edges."""
    turn = np.linspace(0, 2 * np.pi, 2001)
    circle = RADIUS * np.column_stack([np.cos(turn), np.sin(turn) * 0.8, np.sin(turn) * 0.6])
    places = nearest_places(*sphere, circle)
    outwards = _assert_frames(places)
    assert np.degrees(np.arccos(np.min(np.sum(outwards * circle / RADIUS, axis=1)))) < 1.5
    step = np.linalg.norm(np.diff(outwards, axis=0), axis=1)
    assert step.max() < 4 * (turn[1] - turn[0])


@pytest.mark.parametrize("shape", ["sphere", "block"])
def test_places_cover_the_surface(request, shape) -> None:
    nodes, faces = request.getfixturevalue(shape)
    spacing = 8e-3
    places, apart = SurfaceWorkspace.over(nodes, faces, _anywhere, spacing).grid(5)
    np.testing.assert_array_equal(apart, [spacing, spacing])
    np.testing.assert_array_equal(places, SurfaceWorkspace.over(nodes, faces, _anywhere, spacing).places)
    _assert_frames(places)
    corners = nodes[faces]
    area = np.linalg.norm(np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), axis=1).sum() / 2
    # As few as discs of that radius that cover a plane, at most as many as points so far apart in it.
    assert 2 / 27**0.5 < len(places) * spacing**2 / area < 2 / 3**0.5
    random = np.random.default_rng(1)
    for point in corners[random.integers(len(corners), size=60)].mean(axis=1):
        assert np.linalg.norm(places[:, 0] - point, axis=1).min() < 1.25 * spacing
    between = np.linalg.norm(places[:, None, 0] - places[:, 0], axis=2)[np.triu_indices(len(places), 1)]
    assert between.min() > spacing


def test_places_keep_to_a_region_up_to_its_edge(block) -> None:
    """At a box's edge the top still looks upwards, so that all of it is in a region of upward normals."""
    workspace = SurfaceWorkspace.over(*block, lambda points, normals: normals[:, 2] > 0.999, 4e-3)
    np.testing.assert_allclose(workspace.places[:, 0, 2], 0.02, atol=1e-12)
    low, high = workspace.places[:, 0].min(axis=0), workspace.places[:, 0].max(axis=0)
    np.testing.assert_allclose(low[:2], 0.0, atol=2e-3)
    np.testing.assert_allclose(high[:2], [0.06, 0.04], atol=2e-3)
    with pytest.raises(MeshError, match="no part of the outer surface"):
        SurfaceWorkspace.over(*block, lambda points, normals: points[:, 2] > 1.0, 4e-3)


def test_what_has_moved_lands_on_the_surface(block) -> None:
    workspace = SurfaceWorkspace.over(*block, _anywhere, 8e-3)
    place = nearest_places(*block, np.array([[0.055, 0.02, 0.02]]))
    moved = place.copy()
    moved[0, 0] += [8e-3, 1e-3, 0.0]
    landed = workspace.landed(moved)
    np.testing.assert_allclose(landed[0, 0], [0.06, 0.021, 0.02], atol=1e-12)
    _assert_frames(landed)


def _anywhere(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    assert points.shape == normals.shape
    return np.ones(len(points), bool)
