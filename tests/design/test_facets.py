"""Facets close a surface, lie on it, and are as near to it as they should be with few triangles."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.design.facets import facets
from softfuse.errors import SoftfuseError
from softfuse.mesh.surface import enclosed_volume
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.profile import FreeForm, RoundedBox, Superellipsoid

BOX = CavityShape(RoundedBox())
BALL = CavityShape(Superellipsoid())
KINDS = [
    (BOX, [0.01, 0.0, 0.0, 0.014, 0.014, 0.003, 0.1, 0.0, 0.3, 0.001]),
    (BALL, [0.0, 0.0, 0.01, 0.01, 0.006, 0.004, 0.0, 0.0, 0.0, 0.4]),
    (
        CavityShape(FreeForm(Superellipsoid(), 2)),
        [0.0, 0.0, 0.0, 0.01, 0.008, 0.006, 0.0, 0.0, 0.0, 1.0, 0.1, 0.0, 0.1, 0.0, 0.1],
    ),
]


@pytest.mark.parametrize(("kind", "values"), KINDS)
def test_each_edge_belongs_to_two_triangles_in_both_senses(kind, values) -> None:
    points, faces = facets(kind, jnp.array(values), 20e-6)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(e) for e in edges.tolist()} == {(b, a) for a, b in edges.tolist()}
    assert len(points) - len(edges) // 2 + len(faces) == 2
    assert enclosed_volume(points, faces) > 0.0


def test_facets_of_a_ball_are_within_the_tolerance_of_it() -> None:
    values = jnp.array([0.0, 0.0, 0.0, 0.01, 0.01, 0.01, 0.0, 0.0, 0.0, 1.0])
    before = 0
    for height in (80e-6, 20e-6, 5e-6):
        points, faces = facets(BALL, values, height)
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.01, rtol=1e-12)
        middles = np.linalg.norm(points[faces].mean(axis=1), axis=1)
        # The middle of a triangle lies deeper than those of its edges, by a third in an equilateral one.
        assert 0.0 < 0.01 - middles.min() < 1.5 * height
        assert len(faces) > before
        before = len(faces)


def test_narrow_fillets_are_resolved_with_few_triangles() -> None:
    shape, values = KINDS[0]
    _, wide = facets(shape, jnp.array(values), 20e-6)
    _, narrow = facets(shape, jnp.array([*values[:-1], 0.0002]), 20e-6)
    assert len(wide) < 15_000
    assert len(narrow) < 15_000


def test_a_tolerance_that_takes_too_many_triangles_is_refused() -> None:
    shape, values = KINDS[1]
    with pytest.raises(SoftfuseError, match="more than 500000 triangles"):
        facets(shape, jnp.array(values), 1e-9)
