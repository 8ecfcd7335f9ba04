"""Surfaces of cavities against their equations, volumes in closed form and differences."""

from math import gamma

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import sph_harm_y

from softfuse.mesh.shell import checked
from softfuse.mesh.surface import enclosed_volume
from softfuse.robot.layout.cavity_shape import CavityShape, rotation
from softfuse.robot.layout.cube_sphere import cube_sphere
from softfuse.robot.layout.profile import FreeForm, RoundedBox, Superellipsoid, harmonics

HALF = jnp.array([0.014, 0.012, 0.003])
GRID, FACES = cube_sphere(60)
PLACE = [0.01, -0.02, 0.005, *HALF.tolist(), 0.3, -0.2, 0.7]
KINDS = [
    (RoundedBox(), [0.0001]),
    (RoundedBox(), [0.002]),
    (RoundedBox(), [0.0029]),
    (Superellipsoid(), [0.1]),
    (Superellipsoid(), [0.5]),
    (Superellipsoid(), [1.0]),
    (FreeForm(RoundedBox(), 3), [0.001, *(0.02 * np.cos(np.arange(12)))]),
]


def volume(profile, parameters, half=HALF) -> float:
    points = half * (profile.radius(jnp.array(parameters), half, GRID)[:, None] * GRID)
    return enclosed_volume(np.asarray(points), FACES)


def test_the_grid_is_a_closed_surface_that_holds_corners_edges_and_axes() -> None:
    directions, faces = cube_sphere(4)
    assert len(directions) == 6 * 16 + 2 and len(faces) == 12 * 16
    assert len(checked(directions, faces).nodes) == len(directions)
    assert enclosed_volume(GRID, FACES) == pytest.approx(4 / 3 * np.pi, rel=1e-3)
    for one in ([1.0, 0, 0], [0, -1.0, 0], [1.0, 1.0, -1.0], [0, 1.0, -1.0]):
        assert np.abs(directions - one / np.linalg.norm(one)).sum(axis=1).min() < 1e-12


@pytest.mark.parametrize("fillet", [0.0001, 0.001, 0.003])
def test_a_rounded_box_is_all_that_is_within_a_fillet_of_its_core(fillet: float) -> None:
    radius = RoundedBox().radius(jnp.array([fillet]), HALF, GRID)
    points = np.asarray(HALF * (radius[:, None] * GRID))
    core = np.asarray(HALF) - fillet
    apart = np.linalg.norm(points - np.clip(points, -core, core), axis=1)
    np.testing.assert_allclose(apart, fillet, rtol=1e-9)
    a, b, c = 2 * core
    exact = a * b * c + 2 * (a * b + b * c + c * a) * fillet
    exact += np.pi * (a + b + c) * fillet**2 + 4 / 3 * np.pi * fillet**3
    assert volume(RoundedBox(), [fillet]) == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("rho", [0.1, 0.4, 1.0])
def test_a_superellipsoid_has_its_volume(rho: float) -> None:
    n = 2 / rho
    exact = 8 * float(np.prod(HALF)) * gamma(1 + 1 / n) ** 3 / gamma(1 + 3 / n)
    assert volume(Superellipsoid(), [rho]) == pytest.approx(exact, rel=2e-3)


def test_harmonics_are_those_of_scipy() -> None:
    polar, azimuth = np.arccos(GRID[:, 2]), np.arctan2(GRID[:, 1], GRID[:, 0])
    columns = []
    for n in range(2, 5):
        for m in range(-n, n + 1):
            value = np.sqrt(4 * np.pi) * (-1) ** m * sph_harm_y(n, abs(m), polar, azimuth)
            columns.append(value.real if m == 0 else np.sqrt(2) * (value.imag if m < 0 else value.real))
    np.testing.assert_allclose(harmonics(4, GRID), np.stack(columns, axis=1), atol=1e-12)


def test_a_free_form_without_coefficients_is_its_base_and_swells_with_them() -> None:
    shape, base = FreeForm(Superellipsoid(), 2), Superellipsoid()
    none = jnp.zeros(6).at[0].set(0.3)
    np.testing.assert_allclose(shape.radius(none, HALF, GRID), base.radius(none[:1], HALF, GRID), rtol=1e-14)
    assert len(shape.names) == 6 and shape.names[1] == "harmonic 2 -2"
    # The sum rule Σ_m Y² = 2 l + 1 at any direction, here the pole, where only m = 0 is not 0.
    swollen = shape.radius(none.at[3].set(0.1), HALF, np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(swollen, np.exp(0.1 * np.sqrt(5.0)), rtol=1e-12)


@pytest.mark.parametrize(("profile", "parameters"), KINDS)
def test_points_and_reach_have_the_derivatives_of_differences(profile, parameters) -> None:
    shape = CavityShape(profile)
    values = jnp.array([*PLACE, *parameters])
    # Corners, edges and axes are among these directions, where powers and maxima have their kinks.
    directions, _ = cube_sphere(6)
    normals = jnp.asarray(cube_sphere(5)[0])

    def all_of(v):
        return jnp.concatenate([shape.points(v, directions).ravel(), shape.reach(v, normals)])

    forward, backward = jax.jit(jax.jacfwd(all_of))(values), jax.jit(jax.jacrev(all_of))(values)
    np.testing.assert_allclose(forward, backward, atol=1e-12)
    compiled = jax.jit(all_of)
    for k, step in enumerate([1e-7] * 6 + [1e-5] * 3 + [1e-3 * abs(p) + 1e-9 for p in parameters]):
        ahead, behind = compiled(values.at[k].add(step)), compiled(values.at[k].add(-step))
        difference = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(forward[:, k], difference, atol=3e-4 * np.abs(difference).max() + 1e-7)


@pytest.mark.parametrize(("profile", "parameters"), KINDS)
def test_a_shape_reaches_as_far_as_its_points(profile, parameters) -> None:
    shape = CavityShape(profile)
    values = jnp.array([*PLACE, *parameters])
    normals = jnp.asarray(cube_sphere(5)[0])
    sampled = np.asarray(normals @ shape.points(values, cube_sphere(150)[0]).T).max(axis=1)
    reach = np.asarray(shape.reach(values, normals))
    # Samples reach less far, the free form's own samples too.
    tolerance = 1.5e-4 if isinstance(profile, FreeForm) else 1e-6
    assert (reach - sampled).min() > -tolerance
    assert (reach - sampled).max() < 5e-5


def test_half_sizes_are_those_of_the_bounding_box() -> None:
    for profile, parameters in KINDS[:6]:
        values = jnp.array([*PLACE[:6], 0.0, 0.0, 0.0, *parameters])
        reach = CavityShape(profile).reach(values, jnp.eye(3))
        # A superellipsoid's support function is softened where components are 0.
        tolerance = 1e-12 if isinstance(profile, RoundedBox) else 3e-7
        np.testing.assert_allclose(reach, values[:3] + HALF, atol=tolerance)


def test_what_has_no_room_for_its_fillet_says_so() -> None:
    slack = CavityShape(FreeForm(RoundedBox(), 2)).slack(jnp.array([*PLACE, 0.004, *[0.0] * 5]))
    np.testing.assert_allclose(slack, HALF - 0.004, rtol=1e-12)


def test_a_rotation_vector_turns_about_itself() -> None:
    vector = jnp.array([0.3, -0.5, 0.9])
    turn = rotation(vector)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(turn @ vector, vector, atol=1e-14)
    angle = float(jnp.linalg.norm(vector))
    assert float(jnp.trace(turn)) == pytest.approx(1 + 2 * np.cos(angle))
    np.testing.assert_allclose(rotation(jnp.array([0, 0, np.pi / 2])) @ jnp.eye(3)[0], [0, 1, 0], atol=1e-15)
    # To first order about nothing: v × x.
    slope = jax.jacfwd(rotation)(jnp.zeros(3))
    np.testing.assert_allclose(slope[:, :, 2] @ jnp.eye(3)[0], [0, 1, 0], atol=1e-15)
    near = jax.jacfwd(rotation)(jnp.array([0, 0, 1.1e-6])), jax.jacfwd(rotation)(jnp.array([0, 0, 0.9e-6]))
    np.testing.assert_allclose(near[0], near[1], atol=1e-6)
