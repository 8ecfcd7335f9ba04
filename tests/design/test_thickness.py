"""Walls against distances in closed form, dense sampling and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from softfuse.mesh.block import NO_BOXES, Block
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.cube_sphere import cube_sphere
from softfuse.robot.layout.layout import Parameter, TiedLayout
from softfuse.robot.layout.profile import AbstractProfile, FreeForm, RoundedBox, Superellipsoid
from softfuse.robot.layout.thickness import clearances, separation, slacks, wall_names, wall_thicknesses

OUTLINE = Block(
    np.array([-0.04, -0.03, 0.0]),
    np.array([0.04, 0.03, 0.02]),
    NO_BOXES,
    np.array([[[0.02, -0.03, 0.0], [0.03, 0.03, 0.006]]]),
    ((0.0,), (0.0,), (0.02,)),
)


def shape(profile: AbstractProfile, place, half, turn, parameters) -> tuple[CavityShape, dict[str, float]]:
    kind = CavityShape(profile)
    return kind, dict(zip(kind.names, [*place, *half, *turn, *parameters], strict=True))


ROUND = shape(Superellipsoid(), (-0.02, 0.0, 0.01), (0.01, 0.008, 0.004), (0.3, 0.1, -0.4), (0.6,))
BOX = shape(RoundedBox(), (0.004, 0.005, 0.011), (0.009, 0.006, 0.003), (0.1, -0.2, 0.5), (0.001,))
BALL = shape(Superellipsoid(), (0.025, -0.005, 0.013), (0.003, 0.003, 0.003), (0.0, 0.0, 0.0), (1.0,))


def layout_of(*cavities) -> TiedLayout:
    """All values of all cavities are free."""
    free = [
        Parameter(f"{name} {k}", value, value - 1, value + 1, adds={(k, name): 1.0})
        for k, (_, values) in enumerate(cavities)
        for name, value in values.items()
    ]
    return TiedLayout.of(OUTLINE, cavities, free)


@pytest.mark.slow
def test_walls_of_balls_and_faces_are_exact() -> None:
    other = shape(Superellipsoid(), (0.005, 0.004, 0.012), (0.002, 0.002, 0.002), (0.3, 0.2, 0.1), (1.0,))
    layout = layout_of(BALL, other)
    thick = dict(zip(wall_names(layout), np.asarray(wall_thicknesses(layout, layout.start)), strict=True))
    assert len(thick) == 12 + 2 + 1
    assert thick["cavity 0, high z"] == pytest.approx(0.02 - 0.013 - 0.003, abs=1e-9)
    assert thick["cavity 0, low x"] == pytest.approx(0.065 - 0.003, abs=1e-9)
    assert thick["cavity 0, notch 0"] == pytest.approx(0.007 - 0.003, abs=1e-9)
    # The notch's edge at x = 20 mm, z = 6 mm.
    assert thick["cavity 1, notch 0"] == pytest.approx(np.hypot(0.015, 0.006) - 0.002, abs=1e-9)
    between = np.sqrt(0.02**2 + 0.009**2 + 0.001**2) - 0.005
    assert thick["cavity 0, cavity 1"] == pytest.approx(between, abs=1e-9)


@pytest.mark.slow
def test_points_are_as_far_from_balls_and_boxes_as_they_are() -> None:
    box = shape(RoundedBox(), (0.0, 0.0, 0.01), (0.01, 0.006, 0.003), (0.0, 0.0, 0.0), (0.001,))
    layout = layout_of(BALL, box)
    points = jnp.array([[0.025, -0.005, 0.018], [0.0, 0.0, 0.017], [0.013, 0.01, 0.01], [0.002, 0.0, 0.01]])
    away = np.asarray(clearances(layout, jnp.asarray(layout.start), points)).reshape(2, 4)
    np.testing.assert_allclose(
        away[0], np.linalg.norm(points - jnp.array([0.025, -0.005, 0.013]), axis=1) - 0.003, atol=1e-9
    )
    # From a face, from a fillet, from inside; corners reach less far by a hundred-thousandth of the box.
    edge = np.hypot(0.004, 0.005) - 0.001
    np.testing.assert_allclose(away[1, 1:], [0.004, edge, -0.003], atol=1e-7)


@pytest.fixture(scope="module")
def three():
    """A layout of three kinds and its walls as a compiled function of θ."""
    layout = layout_of(ROUND, BOX, BALL)
    return layout, jax.jit(lambda theta: wall_thicknesses(layout, theta))


@pytest.mark.slow
def test_walls_are_those_of_dense_samples(three) -> None:
    layout, walls = three
    thick = dict(zip(wall_names(layout), np.asarray(walls(jnp.asarray(layout.start))), strict=True))
    directions, _ = cube_sphere(150)
    points = [np.asarray(p) for p in layout.points(jnp.asarray(layout.start), [directions] * 3)]
    for j, k in ((0, 1), (0, 2), (1, 2)):
        sampled = cKDTree(points[j]).query(points[k])[0].min()
        assert -1e-6 <= sampled - thick[f"cavity {j}, cavity {k}"] < 2e-5
    for k in range(3):
        assert -1e-6 <= (0.02 - points[k][:, 2].max()) - thick[f"cavity {k}, high z"] < 5e-6
        low, high = OUTLINE.notches[0]
        sampled = np.linalg.norm(points[k] - np.clip(points[k], low, high), axis=1).min()
        assert -1e-6 <= sampled - thick[f"cavity {k}, notch 0"] < 2e-5


@pytest.mark.slow
def test_walls_have_the_derivatives_of_differences(three) -> None:
    layout, walls = three
    at = jnp.asarray(layout.start)
    slope = jax.jit(jax.jacfwd(walls))(at)
    np.testing.assert_allclose(slope, jax.jit(jax.jacrev(walls))(at), atol=1e-12)
    for k, name in enumerate(layout.names):
        h = 1e-5 if name.startswith(("turn", "roundness")) else 1e-6
        difference = (walls(at.at[k].add(h)) - walls(at.at[k].add(-h))) / (2 * h)
        np.testing.assert_allclose(slope[:, k], difference, atol=1e-6 + 1e-6 * np.abs(difference).max())


def test_aligned_boxes_are_found_apart_and_overlapping() -> None:
    first = shape(RoundedBox(), (0.0, 0.0, 0.01), (0.005, 0.005, 0.003), (0, 0, 0), (0.0005,))
    for gap in (0.002, 1e-5, -0.001):
        x = 0.01 + gap
        second = shape(RoundedBox(), (x, 0.001, 0.0105), (0.005, 0.004, 0.003), (0, 0, 0), (0.001,))
        layout = layout_of(first, second)
        assert wall_thicknesses(layout, jnp.asarray(layout.start))[-1] == pytest.approx(gap, abs=1e-9)


@pytest.mark.slow
def test_a_hull_makes_walls_thinner_not_thicker() -> None:
    # Pinched about its waist: towards +x it is not convex.
    waist = np.zeros(5)
    waist[2] = 0.15
    dumb = shape(FreeForm(Superellipsoid(), 2), (0, 0, 0.01), (0.004,) * 3, (0, 0, 0), (1.0, *waist))
    layout = layout_of(dumb, BALL)
    start = jnp.asarray(layout.start)
    thick = np.asarray(wall_thicknesses(layout, start))
    directions, _ = cube_sphere(120)
    points = [np.asarray(p) for p in layout.points(start, [directions] * 2)]
    true = cKDTree(points[0]).query(points[1])[0].min()
    assert true - 3e-3 < thick[-1] <= true + 1e-5


def test_bodies_may_be_the_users_own() -> None:
    def ball(at, radius):
        return lambda n: n @ jnp.array(at) + radius

    gap = separation(ball([0.0, 0.0, 0.0], 1.0), ball([3.0, 4.0, 0.0], 2.0), jnp.eye(3))
    assert gap == pytest.approx(2.0, abs=1e-9)


def test_slack_is_the_room_for_fillets() -> None:
    layout = layout_of(BOX, BALL)
    np.testing.assert_allclose(slacks(layout, jnp.asarray(layout.start)), [0.008, 0.005, 0.002], rtol=1e-12)
