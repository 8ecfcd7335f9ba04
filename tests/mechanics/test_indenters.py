"""Indenters on blocks and domes: against Hertz and a layer's correction, against each other in their limits,
and force against depth.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.functional import ContactSurface, flat_punch, uniform
from softfuse.functional.pressure_cells import even, strip
from softfuse.functional.skin import Skin
from softfuse.material import NeoHookean
from softfuse.mechanics import Loads, Multifrontal, Newton, State, solve
from softfuse.mechanics.indenters import (
    AtDepth,
    CylinderIndenter,
    FlatIndenter,
    SphereIndenter,
    SurfaceForce,
    SurfacePatches,
)
from softfuse.mechanics.punch import Punch
from softfuse.mechanics.solution import RESULTS
from softfuse.mesh.surface import boundary_faces

YOUNG, POISSON, HEIGHT = 1e5, 0.3, 0.02
UP = np.array([[0.0, 0.0, HEIGHT], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _graded(half: float, finest: float, growth: float = 1.6) -> np.ndarray:
    steps = finest * growth ** np.arange(40)
    one = np.append(0.0, np.cumsum(steps))
    one = one[: int(np.searchsorted(one, half))]
    one = one * half / one[-1]
    return np.concatenate([-one[:0:-1], one])


@pytest.fixture(scope="module")
def block(box) -> tuple[Body, Skin, Newton]:
    """40 x 40 x 20 mm, held below, finest at the middle of its top."""
    fine = 1e-3 * np.array([0, 1.0, 2.0, 3.5, 8.0, 20.0])
    plane = np.concatenate([-fine[:0:-1], fine])
    mesh = mesh_for(QUADRATIC, box(plane, plane, HEIGHT - fine[::-1]))
    law = NeoHookean.from_young(YOUNG, POISSON)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=QUADRATIC)
    faces = boundary_faces(mesh).faces
    return body, Skin.of(faces, mesh.nodes, 5e-3), Newton(Multifrontal.plan(body))


@pytest.fixture(scope="module")
def pressed() -> Callable:
    """pressed(body, newton, contact, place, drive): the state, and what answers its drive."""

    @eqx.filter_jit
    def run(body, newton, contact, place, drive):
        loads = Loads((contact.load(body, place),))
        found = solve(newton, body, loads, drive, State.rest(body, loads))
        state = found.state
        answer = loads.conjugate(state.force, state.internal, loads.values(body, state.z))
        return state, answer, found.result

    def press(body, newton, contact, place, drive):
        state, answer, result = run(body, newton, contact, jnp.asarray(place), jnp.atleast_1d(drive))
        assert result == RESULTS.converged
        return state, np.asarray(answer)

    return press


def _layer_of_hertz(radius: float, depth: float) -> float:
    """Force [N] on a sphere in a layer bonded to a rigid base: Hertz, times a series in χ = √(R δ)/h.

    Dimitriadis, Horkay, Maresca, Kachar and Chadwick, Biophys. J. 82, 2002, eqs. 10 to 12.
    """
    a0 = -(1.2876 - 1.4678 * POISSON + 1.3442 * POISSON**2) / (1 - POISSON)
    b0 = (0.6387 - 1.0277 * POISSON + 1.5164 * POISSON**2) / (1 - POISSON)
    x = np.sqrt(radius * depth) / HEIGHT
    series = 1 - 2 * a0 / np.pi * x + 4 * a0**2 / np.pi**2 * x**2
    series -= 8 / np.pi**3 * (a0**3 + 4 * np.pi**2 / 15 * b0) * x**3
    return 4 / 3 * YOUNG / (1 - POISSON**2) * np.sqrt(radius) * depth**1.5 * series


def test_sphere_is_that_of_hertz(block, pressed) -> None:
    """To 4 % in force at a depth; its contact ends at a = √(R δ); and force drives to the same state."""
    body, skin, newton = block
    radius, depth = 0.012, 0.4e-3
    sphere = SphereIndenter(skin, even(), radius, 3.2e-3)
    state, force = pressed(body, newton, AtDepth(sphere), UP, depth)
    np.testing.assert_allclose(force, _layer_of_hertz(radius, depth), rtol=0.04)
    push = np.asarray(state.internal)
    cells = sphere.cells
    middle = 3.2e-3 * np.array([np.asarray(cells.points)[np.asarray(cells.cell) == k].mean(axis=0)
                                for k in range(cells.count)])  # fmt: skip
    from_axis, a = np.linalg.norm(middle, axis=1), np.sqrt(radius * depth)
    assert np.all(push[from_axis < 0.8 * a] > 0)
    assert np.all(np.abs(push[from_axis > 1.25 * a]) < 1e-9)
    # Pressure falls like √(1 − (r/a)²): the mean of r² over the force is 2/5 a².
    np.testing.assert_allclose(push @ from_axis**2 / push.sum(), 0.4 * a**2, rtol=0.08)
    again, back = pressed(body, newton, sphere, UP, force[0])
    np.testing.assert_allclose(back, depth, rtol=1e-6)
    np.testing.assert_allclose(again.z, state.z, atol=1e-9)
    assert float(pressed(body, newton, AtDepth(sphere), UP, -1e-3)[1][0]) == 0.0


def test_cylinder_is_that_of_hertz(block, pressed) -> None:
    """In the middle of its length: pressure falls like √(1 − (y/b)²) with b² = 4 F' R/(π E*)."""
    body, skin, newton = block
    radius, along, across = 8e-3, 7, 12
    cylinder = CylinderIndenter(skin, strip(0.35, along, across, points=2), radius, 7e-3, (0.0, 1.0))
    force = np.asarray(pressed(body, newton, cylinder, UP, 0.6)[0].force).reshape(along, across, 3)
    np.testing.assert_allclose(force[..., 2].sum(), -0.6, rtol=1e-8)
    middle = -force[along // 2, :, 2]
    at = 0.35 * 7e-3 * (2 * (np.arange(across) + 0.5) / across - 1)
    half_width = np.sqrt(
        4 * (middle.sum() / (2 * 7e-3 / along)) * radius * (1 - POISSON**2) / (np.pi * YOUNG)
    )
    assert half_width < 0.9 * at[-1]
    # The mean of y² over the force is b²/4, and over a cell's width w²/12 more.
    width = at[1] - at[0]
    spread = middle @ at**2 / middle.sum() + width**2 / 12
    np.testing.assert_allclose(spread, half_width**2 / 4, rtol=0.1)


def test_a_huge_sphere_is_a_flat_punch(block, pressed) -> None:
    body, skin, newton = block
    cells = flat_punch((0.6, 1.0), (4, 8))
    flat = FlatIndenter(skin, cells, 3e-3)
    state, depth = pressed(body, newton, flat, UP, 0.5)
    other, same = pressed(body, newton, SphereIndenter(skin, cells, 1e3, 3e-3), UP, 0.5)
    np.testing.assert_allclose(same, depth, rtol=1e-4)
    np.testing.assert_allclose(np.asarray(other.force).reshape(-1, 3)[:, 2], -state.force, rtol=1e-3)
    back, force = pressed(body, newton, AtDepth(flat), UP, depth)
    np.testing.assert_allclose(force, 0.5, rtol=1e-6)
    np.testing.assert_allclose(back.z, state.z, atol=1e-10)


def test_flat_tops_are_the_same_by_either_search(block) -> None:
    """Away from the middle, where faces are met by a table or among the nearest."""
    body, skin, _ = block
    place = jnp.asarray(UP).at[0].add(jnp.array([4e-3, -2.5e-3, 0.0]))
    top = ContactSurface.facing(np.asarray(skin.faces), np.asarray(body.rest), np.array([0.0, 0.0, -1.0]))
    loads = [FlatIndenter(surface, flat_punch(), 4e-3).load(body, place) for surface in (skin, top)]
    np.testing.assert_allclose(loads[0].ports.slopes, loads[1].ports.slopes, atol=1e-12)
    np.testing.assert_allclose(loads[0].ports.rest, 0.0, atol=1e-15)


@pytest.fixture(scope="module")
def dome(box) -> tuple[Body, Skin, Newton]:
    """A block of 30 x 30 x 12 mm whose top is raised to a paraboloid with a radius of 20 mm at its apex."""
    plane = _graded(0.015, 1.5e-3, 1.4)
    mesh = box(plane, plane, np.array([0.0, 4e-3, 8e-3, 10e-3, 12e-3]))
    x, y, z = mesh.nodes.T
    mesh.nodes[:, 2] = z * (1 - (x**2 + y**2) / (2 * 0.02) / 12e-3)
    mesh = mesh_for(QUADRATIC, mesh)
    law = NeoHookean.from_young(YOUNG, POISSON)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=QUADRATIC)
    skin = Skin.of(boundary_faces(mesh).faces, mesh.nodes, 6e-3)
    return body, skin, Newton(Multifrontal.plan(body))


def test_a_flat_punch_first_touches_a_dome_at_its_apex(dome, pressed) -> None:
    """A dome under a plane is a plane under a sphere: it starts from a point, and stiffens as it flattens."""
    body, skin, newton = dome
    apex = np.array([[0.0, 0.0, 12e-3], *UP[1:]])
    flat = FlatIndenter(skin, even(), 4e-3)
    heights = np.asarray(flat.load(body, jnp.asarray(apex)).ports.rest)
    radius = np.sqrt([np.mean(np.sum(np.asarray(flat.cells.points)[np.asarray(flat.cells.cell) == k] ** 2, 1))
                      for k in range(flat.cells.count)]) * 4e-3  # fmt: skip
    np.testing.assert_allclose(heights, radius**2 / (2 * 0.02), atol=3e-5)
    light, heavy = (pressed(body, newton, flat, apex, force) for force in (0.02, 1.0))
    touching = [int(np.sum(np.asarray(state.force) > 1e-6)) for state, _ in (light, heavy)]
    assert 4 <= touching[0] < touching[1]
    # Hertz: depth grows like F^(2/3): fifty times the force goes 13.6 times as deep, a flat punch 50 times.
    assert 9 < float(heavy[1][0] / light[1][0]) < 20


def test_a_dome_is_pressed_along_its_own_normal(dome, pressed) -> None:
    body, skin, newton = dome
    place = skin.places_at(np.asarray(body.rest), np.array([[6e-3, 0.0, 13e-3]]), along=(1, 0, 0))[0]
    inwards = np.cross(place[1], place[2])
    np.testing.assert_allclose(inwards / inwards[2], [0.3, 0.0, 1.0], atol=0.05)
    state, _ = pressed(body, newton, SphereIndenter(skin, even(), 4e-3, 3e-3), place, 0.3)
    force = np.asarray(state.force).reshape(-1, 3).sum(axis=0)
    np.testing.assert_allclose(force @ inwards, 0.3, rtol=1e-6)
    assert np.linalg.norm(np.cross(force, inwards)) < 0.05 * 0.3


def test_cells_beyond_an_edge_carry_nothing(block, pressed) -> None:
    body, skin, newton = block
    place = UP + np.array([[0.0185, 0.0, 0.0], [0, 0, 0], [0, 0, 0]])
    cells = even((0.5, 1.0), (4, 12))
    for indenter in (FlatIndenter(skin, cells, 4e-3), SphereIndenter(skin, cells, 8e-3, 4e-3)):
        state, _ = pressed(body, newton, indenter, place, 0.2)
        force = np.asarray(state.force).reshape(cells.count, -1)[:, -1]
        np.testing.assert_allclose(np.abs(force).sum(), 0.2, rtol=1e-6)
        over = np.array([np.all(np.asarray(cells.points)[np.asarray(cells.cell) == k, 0] * 4e-3 > 1.5e-3)
                         for k in range(cells.count)])  # fmt: skip
        assert over.sum() == 4
        np.testing.assert_allclose(force[over], 0.0, atol=1e-12)


def test_a_force_vector_is_two_patches_normal_and_drags_along_its_tangents(block, pressed) -> None:
    body, skin, newton = block
    push = SurfaceForce(skin, uniform(rings=3, angles=8), 3e-3)
    state, moved = pressed(body, newton, push, UP, jnp.array([0.3, 0.1, -0.05]))
    u, n = UP[1], np.array([0.0, 0.0, -1.0])
    force = np.asarray(state.force)
    np.testing.assert_allclose(np.linalg.norm(force), np.linalg.norm([0.3, 0.1, -0.05]), rtol=1e-9)
    np.testing.assert_allclose(force, 0.3 * n + 0.1 * u - 0.05 * np.cross(n, u), atol=0.02)
    assert moved[0] > 0 and moved[1] > 0 and moved[2] < 0
    only, along = pressed(body, newton, push, UP, jnp.array([0.3, 0.0, 0.0]))
    patch, same = pressed(body, newton, SurfacePatches(skin, uniform(rings=3, angles=8), 3e-3), UP, 0.3)
    np.testing.assert_allclose(along[0], same[0], rtol=1e-9)
    np.testing.assert_allclose(only.z, patch.z, atol=1e-12)


def test_patches_stand_along_the_first_tangent(block) -> None:
    body, skin, _ = block
    patches = SurfacePatches(skin, uniform(rings=3, angles=8), 2e-3, (-3e-3, 5e-3))
    turned = jnp.asarray(UP)[jnp.array([0, 2, 1])] * jnp.array([[1.0], [1.0], [-1.0]])
    load = patches.load(body, turned)
    np.testing.assert_allclose(load.ports.rest[:6].reshape(2, 3)[:, 1], [3e-3, -5e-3], atol=1e-9)
    np.testing.assert_allclose(patches.arms(turned), [-4e-3, 4e-3], atol=1e-15)
    assert patches.drives == load.sizes.drives == 2


def test_rest_gaps_leave_flat_discs_as_they_are(pad, top) -> None:
    body, _ = pad()
    disc = FlatIndenter(top, flat_punch((0.6, 1.0), (1, 4)), 3e-3)
    place = jnp.array([[0.0094, 0.0104, 0.01], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    load = disc.load(body, place)
    assert isinstance(load, Punch)
    np.testing.assert_allclose(load.ports.rest, 0.0, atol=1e-17)
