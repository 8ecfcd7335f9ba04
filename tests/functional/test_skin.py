"""Places on flat, creased and curved surfaces: their frames, how they are moved, and how they are spread."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from softfuse.errors import MeshError
from softfuse.functional.skin import Skin, neighbours
from softfuse.mesh.nearest import nearest_on_triangles
from softfuse.mesh.surface import boundary_faces

RADIUS = 0.03
_moved = jax.jit(lambda skin, rest, place, offset: skin.moved(rest, place, offset))


@pytest.fixture(scope="module")
def sphere() -> tuple[Skin, np.ndarray]:
    """A sphere of 30 mm in some 800 faces, and its nodes."""
    k = np.arange(400) + 0.5
    turn, z = np.pi * (1 + 5**0.5) * k, 1 - 2 * k / 400
    nodes = RADIUS * np.column_stack([np.cos(turn) * np.sqrt(1 - z**2), np.sin(turn) * np.sqrt(1 - z**2), z])
    faces = ConvexHull(nodes).simplices
    corners = nodes[faces]
    inwards = np.einsum("fi,fi->f", np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), corners[:, 0]) < 0
    faces[inwards] = faces[inwards][:, [0, 2, 1]]
    return Skin.of(faces, nodes, 0.01), nodes


@pytest.fixture(scope="module")
def block(box) -> tuple[Skin, np.ndarray]:
    mesh = box(*(np.linspace(0, s, n) for s, n in ((0.06, 7), (0.04, 5), (0.02, 3))))
    return Skin.of(boundary_faces(mesh).faces, mesh.nodes, 0.012), mesh.nodes


def test_nearest_points_are_those_of_a_dense_sampling(sphere) -> None:
    skin, nodes = sphere
    corners = nodes[np.asarray(skin.faces)]
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
    skin, nodes = block
    points = np.array([[0.03, 0.02, 0.03], [0.0599, 0.0001, 0.021], [0.07, 0.01, 0.01], [0.02, -0.01, 0.005]])
    places = skin.places_at(nodes, points, along=(1, 0, 0))
    expected = np.array([[0, 0, 1], [0, 0, 1], [1, 0, 0], [0, -1, 0]], float)
    np.testing.assert_allclose(_assert_frames(places), expected, atol=1e-12)
    np.testing.assert_allclose(places[:, 0], np.clip(points, 0, [0.06, 0.04, 0.02]), atol=1e-12)
    np.testing.assert_allclose(places[[0, 1, 3], 1], [[1, 0, 0]] * 3, atol=1e-12)


def test_directions_vary_smoothly_over_a_sphere(sphere) -> None:
    """They are off the exact ones by far less than the facets', and continuous across edges."""
    skin, nodes = sphere
    turn = np.linspace(0, 2 * np.pi, 2001)
    circle = RADIUS * np.column_stack([np.cos(turn), np.sin(turn) * 0.8, np.sin(turn) * 0.6])
    places = skin.places_at(nodes, circle, along=(0, 0.6, -0.8))
    outwards = _assert_frames(places)
    assert np.degrees(np.arccos(np.min(np.sum(outwards * circle / RADIUS, axis=1)))) < 1.5
    step = np.linalg.norm(np.diff(outwards, axis=0), axis=1)
    assert step.max() < 4 * (turn[1] - turn[0])


def test_moved_places_follow_the_sphere(sphere) -> None:
    """A walk of many small offsets along u is a great circle, and comes back to where it began."""
    skin, nodes = sphere
    place = start = jnp.asarray(skin.places_at(nodes, np.array([[0.0, 0.0, RADIUS]]), along=(1, 0, 0))[0])
    steps = 160
    for _ in range(steps):
        place, there = _moved(skin, nodes, place, jnp.array([2 * np.pi * RADIUS / steps, 0.0]))
        assert bool(there)
        np.testing.assert_allclose(jnp.linalg.norm(place[0]), RADIUS, rtol=0.03)
    assert float(jnp.linalg.norm(place[0] - start[0])) < 0.05 * 2 * np.pi * RADIUS
    _assert_frames(np.asarray(place)[None])


def test_moved_places_have_the_slope_of_differences(sphere) -> None:
    skin, nodes = sphere
    place = jnp.asarray(skin.places_at(nodes, np.array([[0.01, 0.015, 0.02]]), along=(1, 0, 0))[0])
    offset, h, rest = jnp.array([1.1e-3, -0.7e-3]), 1e-7, jnp.asarray(nodes)
    slope = jax.jit(jax.jacfwd(lambda o: skin.moved(rest, place, o)[0]))(offset)
    for k, e in enumerate(np.eye(2)):
        ends = (_moved(skin, nodes, place, offset + sign * h * e)[0] for sign in (1, -1))
        difference = np.subtract(*map(np.asarray, ends)) / (2 * h)
        np.testing.assert_allclose(slope[..., k], difference, atol=1e-6 * np.abs(difference).max())


def test_places_stay_at_an_edge(block) -> None:
    skin, nodes = block
    place = jnp.asarray(skin.places_at(nodes, np.array([[0.055, 0.02, 0.02]]), along=(1, 0, 0))[0])
    moved, there = _moved(skin, nodes, place, jnp.array([4e-3, 1e-3]))
    np.testing.assert_allclose(moved[0], [0.059, 0.021, 0.02], atol=1e-12)
    assert bool(there)
    moved, there = _moved(skin, nodes, place, jnp.array([6e-3, 0.0]))
    np.testing.assert_array_equal(moved, place)
    assert not bool(there)


@pytest.mark.parametrize("shape", ["sphere", "block"])
def test_spread_covers_the_surface_evenly(request, shape) -> None:
    skin, nodes = request.getfixturevalue(shape)
    spacing = 8e-3
    places = skin.spread(nodes, spacing, along=(1, 0, 0))
    np.testing.assert_array_equal(places, skin.spread(nodes, spacing, along=(1, 0, 0)))
    corners = nodes[np.asarray(skin.faces)]
    area = np.linalg.norm(np.cross(*np.diff(corners, axis=1).swapaxes(0, 1)), axis=1).sum() / 2
    assert 0.8 < len(places) * spacing**2 / area < 1.6
    outwards = _assert_frames(places)
    random = np.random.default_rng(1)
    for point in corners[random.integers(len(corners), size=60)].mean(axis=1):
        assert np.linalg.norm(places[:, 0] - point, axis=1).min() < 1.05 * spacing
    for k, others in enumerate(neighbours(places, 2 * spacing)):
        apart = np.linalg.norm(places[others, 0] - places[k, 0], axis=1)
        assert apart.min() > 0.79 * spacing
        assert np.all(outwards[others] @ outwards[k] > 0)


def test_spread_keeps_to_a_region(block) -> None:
    skin, nodes = block
    upper = np.all(nodes[np.asarray(skin.faces), 2] > 0.0199, axis=1)
    places = skin.spread(nodes, 8e-3, along=(1, 0, 0), within=upper)
    np.testing.assert_allclose(places[:, 0, 2], 0.02, atol=1e-12)
    with pytest.raises(MeshError, match="no face"):
        skin.spread(nodes, 8e-3, along=(1, 0, 0), within=np.zeros(len(upper), bool))
