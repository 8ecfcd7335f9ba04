"""Indenters: their laws on an elastic half space, of which only the compliance between cells matters, against
Hertz and each other; their places on flat and domed bodies; and one equilibrium of a body.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softfuse.body import LINEAR, QUADRATIC, Body, mesh_for
from softfuse.functional.contact import ContactSurface
from softfuse.functional.pressure_cells import even, flat_punch, strip, uniform
from softfuse.functional.skin import Skin
from softfuse.functional.workspace import nearest_places
from softfuse.material import NeoHookean
from softfuse.mechanics import Loads, Newton, State, solve
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.held_loads import HeldLoads
from softfuse.mechanics.indenters import (
    AtDepth,
    CylinderIndenter,
    FlatIndenter,
    SphereIndenter,
    SurfaceForce,
    SurfacePatches,
)
from softfuse.mechanics.interface import settle
from softfuse.mechanics.solution import RESULTS
from softfuse.mesh.surface import boundary_faces

HALF, HEIGHT = 0.015, 0.012
STIFFNESS = 1.1e5  # Pa, E/(1 − ν²) of the half space
UP = np.array([[0.0, 0.0, HEIGHT], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
DOWN = -np.cross(UP[1], UP[2])
DOME = 0.02  # m, the radius at its apex
SIDE = 13
GRID = strip(1.0, SIDE, SIDE)
"""Square cells: a force on one sinks all others by a known closed form."""


class Sides(NamedTuple):
    """A body and its skin."""

    body: Body
    skin: Skin


def _body(mesh, element) -> Sides:
    mesh = mesh_for(element, mesh)
    law = NeoHookean.from_young(1e5, 0.3)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=element)
    return Sides(body, Skin.of(boundary_faces(mesh).faces, mesh.nodes, 6e-3))


@pytest.fixture(scope="module")
def block(box) -> Sides:
    """30 x 30 x 12 mm, held below."""
    plane = np.linspace(-HALF, HALF, 7)
    return _body(box(plane, plane, np.array([0.0, 0.5, 1.0]) * HEIGHT), LINEAR)


@pytest.fixture(scope="module")
def dome(box) -> Sides:
    """The same with its top raised to a paraboloid."""
    side = 1e-3 * np.array([0.0, 1, 2, 3, 5, 7, 9, 12, 15])
    plane = np.concatenate([-side[:0:-1], side])
    mesh = box(plane, plane, np.array([0.0, 0.5, 1.0]) * HEIGHT)
    x, y, z = mesh.nodes.T
    mesh.nodes[:, 2] = z * (1 - (x**2 + y**2) / (2 * DOME) / HEIGHT)
    return _body(mesh, LINEAR)


def _half_space(cells, extent: float) -> np.ndarray:
    """Compliance (m, m) [m/N] between square cells under uniform pressure: Johnson, eq. 3.25, at middles."""
    middle = extent * np.array([np.asarray(cells.points)[np.asarray(cells.cell) == k].mean(axis=0)
                                for k in range(cells.count)])  # fmt: skip
    a = extent / SIDE
    x, y = np.moveaxis(middle[:, None] - middle[None], -1, 0)

    def part(p, q, other):
        return p * np.log((q + np.hypot(q, p)) / (other + np.hypot(other, p)))

    total = part(x + a, y + a, y - a) + part(y + a, x + a, x - a)
    total += part(x - a, y - a, y + a) + part(y - a, x - a, x + a)
    return total / (np.pi * STIFFNESS) / (2 * a) ** 2


@eqx.filter_jit
def _settled(load, compliance, drive):
    loads = Loads((load,))
    force, internal, _ = loads.start()
    held = HeldLoads(loads, load.ports.rest)
    found = settle(held, load.ports.rest, compliance, drive, (force, internal))
    y = load.ports.rest + compliance @ found.force
    return found, loads.conjugate(found.force, found.internal, y)


def _on_half_space(contact, sides: Sides, drive: float, place=UP) -> tuple[np.ndarray, float]:
    """Forces along d of the cells (SIDE, SIDE), and what answers the drive, on a half space."""
    load = contact.load(sides.body, jnp.asarray(place))
    cells = GRID.count
    along = _half_space(GRID, 3e-3)
    if load.sizes.forces == 3 * cells:
        along = np.einsum("kl,i,j->kilj", along, DOWN, DOWN).reshape(3 * cells, 3 * cells)
    found, answer = _settled(load, jnp.asarray(along), jnp.array([drive]))
    assert bool(found.found)
    force = np.asarray(found.force).reshape(cells, -1)
    return (force @ DOWN if force.shape[1] == 3 else force[:, 0]).reshape(SIDE, SIDE), float(answer[0])


MIDDLES = 3e-3 * (2 * (np.arange(SIDE) + 0.5) / SIDE - 1)


def test_sphere_is_that_of_hertz(block) -> None:
    """F = 4/3 E* √R δ^(3/2) in a circle of a² = R δ; driven by that force it goes as deep."""
    radius, depth = 0.02, 0.25e-3
    sphere = SphereIndenter(block.skin, GRID, radius, 3e-3)
    force, total = _on_half_space(AtDepth(sphere), block, depth)
    np.testing.assert_allclose(total, 4 / 3 * STIFFNESS * np.sqrt(radius) * depth**1.5, rtol=0.02)
    from_axis = np.hypot(MIDDLES[:, None], MIDDLES)
    a, cell = np.sqrt(radius * depth), 6e-3 / SIDE
    assert np.all(force[from_axis < a - cell] > 0)
    assert np.all(force[from_axis > a + cell] == 0)
    # Pressure falls like √(1 − (r/a)²): the mean of r² over the force is 2/5 a².
    squares = from_axis**2 + cell**2 / 6
    np.testing.assert_allclose(np.sum(force * squares) / force.sum(), 0.4 * a**2, rtol=0.04)
    again, back = _on_half_space(sphere, block, total)
    np.testing.assert_allclose(back, depth, rtol=1e-6)
    np.testing.assert_allclose(again, force, atol=1e-6 * total)
    assert _on_half_space(AtDepth(sphere), block, -1e-3)[1] == 0.0


def test_cylinder_is_that_of_hertz(block) -> None:
    """In the middle of its length: pressure falls like √(1 − (y/b)²) with b² = 4 F' R/(π E*)."""
    radius = 0.01
    force = _on_half_space(CylinderIndenter(block.skin, GRID, radius, 3e-3), block, 0.25)[0]
    middle, cell = force[SIDE // 2], 6e-3 / SIDE
    half_width = np.sqrt(4 * middle.sum() / cell * radius / (np.pi * STIFFNESS))
    assert 3 * cell < half_width < 2.5e-3
    squares = MIDDLES**2 + cell**2 / 12
    np.testing.assert_allclose(middle @ squares / middle.sum(), half_width**2 / 4, rtol=0.05)
    across = _on_half_space(CylinderIndenter(block.skin, GRID, radius, 3e-3, (0.0, 1.0)), block, 0.25)[0]
    np.testing.assert_allclose(across, force, atol=1e-6 * force.sum())


def test_a_huge_sphere_and_a_huge_cylinder_are_flat_punches(block) -> None:
    flat, depth = _on_half_space(FlatIndenter(block.skin, GRID, 3e-3), block, 0.5)
    for huge in (SphereIndenter(block.skin, GRID, 1e3, 3e-3), CylinderIndenter(block.skin, GRID, 1e3, 3e-3)):
        force, same = _on_half_space(huge, block, 0.5)
        np.testing.assert_allclose(same, depth, rtol=1e-4)
        np.testing.assert_allclose(force, flat, rtol=1e-3, atol=1e-6)
    again, force = _on_half_space(AtDepth(FlatIndenter(block.skin, GRID, 3e-3)), block, depth)
    np.testing.assert_allclose(force, 0.5, rtol=1e-6)
    np.testing.assert_allclose(again, flat, atol=1e-7)


def test_a_flat_punch_on_a_dome_is_a_sphere_on_a_plane(block, dome) -> None:
    """It first touches the apex; each cell's gap is its height below."""
    flat, sphere = FlatIndenter(dome.skin, GRID, 3e-3), SphereIndenter(block.skin, GRID, DOME, 3e-3)
    heights = np.asarray(flat.load(dome.body, jnp.asarray(UP)).ports.rest).reshape(SIDE, SIDE)
    exact = (MIDDLES[:, None] ** 2 + MIDDLES**2) / (2 * DOME)
    # Facets of 1 mm are up to 1²/8R lower than the paraboloid in x and in y.
    assert np.all(np.abs(heights - exact) < 2 * 1e-3**2 / (8 * DOME) + 1e-6)
    assert heights.min() < 2e-5
    on_dome, on_plane = (_on_half_space(each, sides, 0.06) for each, sides in ((flat, dome), (sphere, block)))
    np.testing.assert_allclose(on_dome[1], on_plane[1], rtol=0.1)
    # Far less of the disc carries than under a punch on a plane, where all of it does.
    assert np.sum(on_dome[0] > 0) < 0.7 * GRID.count


def test_a_dome_is_pressed_along_its_own_normal(dome) -> None:
    rest = np.asarray(dome.body.rest)
    place = nearest_places(rest, np.asarray(dome.skin.faces), np.array([[6e-3, 0.0, HEIGHT]]))[0]
    inwards = -np.cross(place[1], place[2])
    np.testing.assert_allclose(inwards / -inwards[2], [-0.3, 0.0, -1.0], atol=0.05)
    load = SphereIndenter(dome.skin, even(), 4e-3, 3e-3).load(dome.body, jnp.asarray(place))
    np.testing.assert_allclose(load.shape.direction, inwards, atol=1e-12)
    gap, normal = load.shape.gaps(load.ports.rest, jnp.zeros(()))
    # The sphere has just touched, near the place, where it pushes along the dome's own normal.
    assert 0.0 <= float(gap.min()) < 2e-5
    nearest = int(np.argmin(gap))
    assert np.degrees(np.arccos(np.asarray(normal)[nearest] @ inwards)) < 8


def test_flat_tops_are_the_same_by_either_search(block) -> None:
    """A table of the faces that look upwards, or the nearest of all; gaps at rest are none."""
    body, skin = block
    place = jnp.asarray(UP).at[0].add(jnp.array([4e-3, -2.5e-3, 0.0]))
    top = ContactSurface.facing(np.asarray(skin.faces), np.asarray(body.rest), DOWN)
    loads = [FlatIndenter(surface, flat_punch(), 4e-3).load(body, place) for surface in (skin, top)]
    np.testing.assert_allclose(loads[0].ports.slopes, loads[1].ports.slopes, atol=1e-12)
    for load in loads:
        np.testing.assert_allclose(load.ports.rest, 0.0, atol=1e-17)


def test_cells_beyond_an_edge_carry_nothing_and_others_all(block) -> None:
    """The place is 1 mm from the edge: of the disc of 3 mm some rows of cells are over nothing."""
    body, skin = block
    place = UP + np.array([[HALF - 1e-3, 0.0, 0.0], [0, 0, 0], [0, 0, 0]])
    beyond = np.broadcast_to((MIDDLES - 3e-3 / SIDE > 1e-3)[:, None], (SIDE, SIDE))
    for indenter in (FlatIndenter(skin, GRID, 3e-3), SphereIndenter(skin, GRID, 0.02, 3e-3)):
        force, _ = _on_half_space(indenter, block, 0.2, place)
        np.testing.assert_allclose(force[beyond], 0.0, atol=1e-12)
        np.testing.assert_allclose(force.sum(), 0.2, rtol=1e-6)
    load = FlatIndenter(skin, GRID, 3e-3).load(body, jnp.asarray(place))
    # The nodes carry the whole of a cell's force, also where only a part of the cell is over the body.
    carried = np.zeros(GRID.count)
    np.add.at(carried, np.asarray(load.ports.cell), np.asarray(load.ports.share).sum(axis=1))
    np.testing.assert_allclose(carried, np.where(beyond.ravel(), 0.0, 1.0), atol=1e-12)


def test_a_force_vector_turns_with_its_patch(block) -> None:
    body, skin = block
    push = SurfaceForce(skin, uniform(rings=3, angles=8), 3e-3)
    load, drive = push.load(body, jnp.asarray(UP)), jnp.array([0.3, 0.1, -0.05])
    assert push.drives == load.sizes.drives == 3
    force = 0.3 * DOWN + 0.1 * UP[1] - 0.05 * UP[2]
    turn = Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
    for r in (np.eye(3), turn):
        y = jnp.asarray((np.asarray(load.ports.rest).reshape(-1, 3) @ r.T).ravel())
        unmet = load.equations(jnp.asarray(r @ force), jnp.zeros(0), y, drive)
        np.testing.assert_allclose(unmet, 0.0, atol=1e-12)
    shifted = load.ports.rest.at[:3].add(jnp.array([2e-3, 1e-3, -4e-3]))
    way = load.conjugate(jnp.zeros(3), jnp.zeros(0), shifted)
    np.testing.assert_allclose(way, [4e-3, 2e-3, 1e-3], rtol=1e-12)


def test_patches_stand_along_the_first_tangent(block) -> None:
    body, skin = block
    patches = SurfacePatches(skin, uniform(rings=3, angles=8), 2e-3, (-3e-3, 5e-3))
    place = jnp.asarray(np.stack([UP[0], UP[2], -UP[1]]))
    load = patches.load(body, place)
    np.testing.assert_allclose(load.ports.rest[:6].reshape(2, 3)[:, 1], [-3e-3, 5e-3], atol=1e-9)
    np.testing.assert_allclose(patches.arms, [-3e-3, 5e-3], atol=1e-15)
    assert patches.drives == load.sizes.drives == 2


@pytest.mark.slow
def test_a_sphere_sinks_deep_into_a_body(box) -> None:
    """Half a radius deep, where cells slide and forces turn: no cell is inside the sphere, none pulls, and
    the force that it takes drives it as deep again.
    """
    plane = 1e-3 * np.array([-8.0, -4, -1.5, 1.5, 4, 8])
    body, skin = _body(box(plane, plane, np.array([0.0, 6e-3, HEIGHT])), QUADRATIC)
    sphere = SphereIndenter(skin, even((0.3, 0.6, 1.0), (4, 6, 8)), 4e-3, 3.5e-3)

    @eqx.filter_jit
    def pressed(contact, drive):
        loads = Loads((contact.load(body, jnp.asarray(UP)),))
        found = solve(Newton(Dense.plan(body)), body, loads, drive, State.rest(body, loads))
        y = loads.values(body, found.state.z)
        return found, loads.conjugate(found.state.force, found.state.internal, y), y, loads.parts[0].shape

    found, force, y, shape = pressed(AtDepth(sphere), jnp.array([2e-3]))
    assert found.result == RESULTS.converged
    push = np.asarray(found.state.internal)
    gap, normal = map(np.asarray, shape.gaps(y, jnp.asarray(2e-3)))
    assert np.all(gap > -1e-9) and np.all(push > -1e-9)
    assert np.all((np.abs(gap) < 1e-8) | (np.abs(push) < 1e-8))
    np.testing.assert_allclose(
        np.asarray(found.state.force).reshape(-1, 3), push[:, None] * normal, atol=1e-9
    )
    # Its forces lean inwards by some tens of degrees.
    assert np.degrees(np.arccos((normal @ DOWN)[push > 1e-6].min())) > 20
    again, depth, *_ = pressed(sphere, force)
    assert again.result == RESULTS.converged
    np.testing.assert_allclose(depth, 2e-3, rtol=1e-6)
