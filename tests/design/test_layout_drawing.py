"""Drawn layouts: meshed as fine as asked, and made with errors as a test bed is."""

from dataclasses import replace
from math import radians

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body.body import Body
from softfuse.body.element import TAYLOR_HOOD
from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity
from softfuse.functional.material_points import MaterialPoints
from softfuse.material import NeoHookean
from softfuse.mesh.morph import reshaped_cavities
from softfuse.mesh.orientation import check
from softfuse.mesh.quality import curved_mean_ratios
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.mesh.tetmesh import TetMesh, quadratic
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout_drawing import LayoutDrawing
from softfuse.robot.layout.profile import FreeForm, RoundedBox, Superellipsoid

HALF = (0.014, 0.012, 0.003)
FOUR = LayoutDrawing(
    (0.08, 0.08, 0.018),
    (
        (CavityShape(RoundedBox()), (-0.017, -0.017, 0.009, *HALF, 0.0, 0.0, 0.17, 0.002)),
        (CavityShape(Superellipsoid()), (-0.017, 0.017, 0.009, *HALF, 0.0, 0.0, 0.0, 0.5)),
        (
            CavityShape(FreeForm(Superellipsoid(), 2)),
            (0.017, -0.017, 0.009, *HALF, 0.0, 0.09, -0.09, 0.3, 0.02, 0.0, 0.01, 0.0, -0.03),
        ),
        (CavityShape(RoundedBox()), (0.017, 0.017, 0.009, *HALF, 0.0, 0.0, 0.0, 0.001)),
    ),
)
"""Every profile, some turned."""
OTHERS = LayoutDrawing(
    (0.08, 0.08, 0.018),
    (
        (
            CavityShape(RoundedBox()),
            (-0.017, -0.017, 0.009, 0.014, 0.013, 0.003, 0.0, 0.0, radians(5), 0.001),
        ),
        (CavityShape(Superellipsoid()), (-0.017, 0.017, 0.009, 0.014, 0.014, 0.003, 0.0, 0.0, 0.0, 0.3)),
        (
            CavityShape(FreeForm(Superellipsoid(), 2)),
            (0.017, -0.017, 0.009, 0.013, 0.014, 0.003, 0.0, 0.0, 0.0, 0.4, 0.0, 0.0, 0.02, 0.0, 0.01),
        ),
        (CavityShape(RoundedBox()), (0.017, 0.017, 0.009, 0.014, 0.014, 0.003, 0.0, 0.0, 0.0, 0.0005)),
    ),
)
EGG = LayoutDrawing(
    (0.04, 0.04, 0.018),
    ((CavityShape(Superellipsoid()), (0.001, 0.0, 0.009, 0.012, 0.01, 0.004, 0.0, 0.0, 0.1, 1.0)),),
)


def test_edges_that_would_turn_tetrahedra_inside_out_are_less_curved() -> None:
    # With the edges of walls curved as the cavities are, this is one of the meshes with inverted tetrahedra.
    mesh = FOUR.mesh(0.01, 0.012, growth=0.5)
    check(mesh)
    assert curved_mean_ratios(mesh).min() > 0.05
    np.testing.assert_array_equal(
        FOUR.centres()[:, :2], 0.017 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    )


def made(drawing: LayoutDrawing, mesh: TetMesh, seed: int) -> TetMesh:
    """With cavities off their places by up to 0.3 mm and their sizes by up to 0.2 mm."""
    rng, centres = np.random.default_rng(seed), drawing.centres()
    shifts, growths = (rng.uniform(-bound, bound, centres.shape) for bound in (0.3e-3, 0.2e-3))
    return quadratic(reshaped_cavities(mesh, shifts, growths, centres=centres))


@pytest.mark.slow
def test_a_point_is_found_in_the_curved_elements_of_a_layout() -> None:
    # The ninth element by how far it is inside those with straight edges is the one that holds it.
    point = np.array([[-0.03, 0.003, 0.0165]])
    mesh = made(OTHERS, OTHERS.mesh(0.01, 0.012, growth=0.5), seed=1)
    law = NeoHookean.from_young(0.6e6, 0.49)
    body = Body.from_mesh(mesh, (law,), mesh.nodes[:, 2] <= 1e-9, element=TAYLOR_HOOD)
    found = MaterialPoints.embedded(body, point)
    carried = np.einsum("ga,gai->gi", found.shape(body.rest), np.asarray(body.rest)[np.asarray(found.nodes)])
    np.testing.assert_allclose(carried, point, atol=1e-12)


def test_a_drawing_without_volume_is_refused() -> None:
    with pytest.raises(MeshError, match="the block has no volume"):
        replace(EGG, size=(0.0, 0.04, 0.018)).layout()


def test_a_cavity_with_errors_of_making_is_as_round_as_drawn() -> None:
    drawn = EGG.mesh(0.012, 0.012, growth=1.0)
    wall = np.unique(cavities(quadratic(drawn), EGG.centres())[0].faces)
    before, after = quadratic(drawn).nodes, made(EGG, drawn, seed=5).nodes
    low, high = before[wall].min(axis=0), before[wall].max(axis=0)
    size = np.ptp(after[wall], axis=0)
    shift = 0.5 * (after[wall].max(axis=0) + after[wall].min(axis=0) - low - high)
    assert 1e-6 < np.abs(shift).max() <= 0.3e-3
    assert 1e-6 < np.abs(size - (high - low)).max() <= 0.2e-3
    moved = 0.5 * (low + high) + shift + (before[wall] - 0.5 * (low + high)) * size / (high - low)
    np.testing.assert_allclose(after[wall], moved, atol=1e-12)
    volume = Cavity.of(cavities(quadratic(drawn), EGG.centres())[0].faces)
    stretch = float(np.prod(size / (high - low)))
    assert float(volume(jnp.asarray(after))) == pytest.approx(
        float(volume(jnp.asarray(before))) * stretch, rel=1e-9
    )
    skin = outer_surface(EGG.mesh(0.012, 0.012)).faces
    np.testing.assert_array_equal(after[skin], before[skin])
