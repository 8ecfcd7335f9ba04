"""The nearest points of triangles, against a dense sampling of these."""

import numpy as np
from scipy.spatial import ConvexHull

from softfuse.mesh.nearest import nearest_on_triangles

RADIUS = 0.03


def test_nearest_points_are_those_of_a_dense_sampling() -> None:
    """On a sphere of 30 mm in some 800 faces."""
    k = np.arange(400) + 0.5
    turn, z = np.pi * (1 + 5**0.5) * k, 1 - 2 * k / 400
    nodes = RADIUS * np.column_stack([np.cos(turn) * np.sqrt(1 - z**2), np.sin(turn) * np.sqrt(1 - z**2), z])
    corners = nodes[ConvexHull(nodes).simplices]
    random = np.random.default_rng(0)
    points = random.normal(size=(40, 3)) * RADIUS
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
