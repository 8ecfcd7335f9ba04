"""Contact rows: unit force through the location, right for every mesh, differentiable in the location."""

import dataclasses
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, QUADRATIC, Body, mesh_for
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch, uniform
from softfuse.material import NeoHookean
from softfuse.mechanics.surface_ports import CellPorts
from softfuse.mesh.surface import boundary_faces

SIZE, HEIGHT, RADIUS = 0.03, 0.012, 0.006
DOWN, OBLIQUE = np.array([0.0, 0.0, -1.0]), np.array([0.3, -0.2, -1.0])
CENTRE = np.array([0.0141, 0.0163, HEIGHT])


@cache
def _body(mesh, element=QUADRATIC) -> Body:
    mesh = mesh_for(element, mesh)
    law = NeoHookean.from_young(1e5, 0.4)
    return Body.from_mesh(mesh, [law], mesh.nodes[:, 2] == 0.0, element=element)


@cache
def _facing(mesh, direction: tuple[float, ...], element) -> ContactSurface:
    mesh = mesh_for(element, mesh)
    return ContactSurface.facing(boundary_faces(mesh).faces, mesh.nodes, np.array(direction))


def _surface(mesh, direction, element=QUADRATIC) -> ContactSurface:
    return _facing(mesh, tuple(direction), element)


def _contact(surface, cells, location=CENTRE, radius=RADIUS) -> Contact:
    return Contact(surface, cells, jnp.asarray(location), jnp.asarray(radius))


_rows = jax.jit(lambda contact, body: CellPorts.of(contact, body).slopes)
_overlap = jax.jit(lambda contact, body: contact.overlap(body))
# Displacements under the cells where the disc stands at `location`.
_under = jax.jit(
    lambda location, contact, body, z: _rows(dataclasses.replace(contact, location=location), body).T @ z
)
_slope = jax.jit(jax.jacfwd(_under))


def _nodal(body: Body, rows) -> np.ndarray:
    """Forces (k, 3, m) of nodes, none where held."""
    return np.concatenate([np.asarray(rows), np.zeros((1, rows.shape[1]))])[
        np.asarray(body.displacement_index)
    ]


def _unknowns(body: Body, displacement) -> np.ndarray:
    z = np.zeros(body.n + 1)
    z[np.asarray(body.displacement_index)] = displacement
    return z[:-1]


@pytest.fixture(scope="module")
def block(box):
    return box([0.0, 0.011, 0.019, SIZE], [0.0, 0.009, 0.017, SIZE], [0.0, 0.005, HEIGHT])


@pytest.fixture(scope="module")
def finer(box):
    x = np.array([0.0, 0.15, 0.33, 0.42, 0.6, 0.8, 1.0]) * SIZE
    return box(x, x[-1] - x[::-1], [0.0, HEIGHT])


@pytest.fixture(scope="module")
def step(box):
    """A block whose upper half is missing for x > SIZE / 2, so that a disc can stand on both levels."""
    keep = np.ones((2, 2, 2), bool)
    keep[1, :, 1] = False
    return box([0.0, 0.5 * SIZE, SIZE], [0.0, 0.4 * SIZE, SIZE], [0.0, 0.5 * HEIGHT, HEIGHT], keep=keep)


@pytest.mark.parametrize("element", [LINEAR, QUADRATIC], ids=lambda e: e.name)
@pytest.mark.parametrize("direction", [DOWN, OBLIQUE], ids=["straight", "oblique"])
def test_unit_force_through_the_location(block, element, direction) -> None:
    body = _body(block, element)
    contact = _contact(_surface(block, direction, element), uniform())
    force = _nodal(body, _rows(contact, body))[..., 0]
    np.testing.assert_allclose(force.sum(axis=0), direction / np.linalg.norm(direction), rtol=0, atol=1e-14)
    moment = np.cross(np.asarray(body.rest) - CENTRE, force).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, rtol=0, atol=1e-13 * RADIUS)


def test_every_cell_pushes_where_it_stands(block, shares) -> None:
    body, cells = _body(block), flat_punch((0.6, 1.0), (2, 5))
    surface = _surface(block, OBLIQUE)
    contact = _contact(surface, cells)
    force = _nodal(body, _rows(contact, body))
    d = np.asarray(surface.direction)
    np.testing.assert_allclose(force.sum(axis=0), np.tile(d[:, None], cells.count), rtol=0, atol=1e-14)
    offset = RADIUS * shares(cells).T @ np.asarray(cells.points @ surface.tangents)
    moment = np.cross(np.asarray(body.rest)[:, :, None] - CENTRE[:, None], force, axis=1).sum(axis=0)
    np.testing.assert_allclose(moment.T, np.cross(offset, d), rtol=0, atol=1e-13 * RADIUS)


def test_a_disc_over_a_step_still_pushes_through_its_location(step) -> None:
    body = _body(step)
    location = np.array([0.47 * SIZE, 0.5 * SIZE, HEIGHT])
    contact = _contact(_surface(step, DOWN), uniform(), location)
    force = _nodal(body, _rows(contact, body))[..., 0]
    np.testing.assert_allclose(force.sum(axis=0), DOWN, rtol=0, atol=1e-14)
    moment = np.cross(np.asarray(body.rest) - location, force).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, rtol=0, atol=1e-13 * RADIUS)
    upper = np.isclose(body.rest[:, 2], HEIGHT)
    x = location[0] + RADIUS * np.asarray(contact.cells.points @ contact.surface.tangents)[:, 0]
    above = float(np.asarray(contact.cells.share)[x < 0.5 * SIZE].sum())
    assert 0.5 < above < 0.9
    np.testing.assert_allclose(force[upper].sum(axis=0), above * DOWN, rtol=0, atol=1e-14)
    np.testing.assert_allclose(force[~upper].sum(axis=0), (1 - above) * DOWN, rtol=0, atol=1e-14)


def test_only_the_outermost_of_two_surfaces_is_pressed(box) -> None:
    """A slot runs through the block: its floor faces the disc as well, but lies behind the roof."""
    keep = np.ones((3, 1, 3), bool)
    keep[1, 0, 1] = False
    z = np.array([0.0, 0.3, 0.7, 1.0]) * HEIGHT
    mesh = box(np.array([0.0, 0.1, 0.9, 1.0]) * SIZE, [0.0, SIZE], z, keep=keep)
    body = _body(mesh)
    rows = _rows(_contact(_surface(mesh, DOWN), uniform()), body)
    force = _nodal(body, rows)[..., 0]
    loaded = np.any(force != 0.0, axis=1)
    assert loaded.any() and np.all(np.isclose(np.asarray(body.rest)[loaded, 2], HEIGHT))
    up = _nodal(body, _rows(_contact(_surface(mesh, -DOWN), uniform()), body))[..., 0]
    # From below it stands on the fixed base.
    np.testing.assert_array_equal(up, 0.0)


def test_linear_fields_are_read_exactly_on_every_mesh(block, finer, shares) -> None:
    slope = np.random.default_rng(0).normal(size=(3, 3))
    cells = flat_punch()
    for direction in (DOWN, OBLIQUE):
        read = []
        for mesh, element in ((block, LINEAR), (block, QUADRATIC), (finer, QUADRATIC)):
            body, surface = _body(mesh, element), _surface(mesh, direction, element)
            z = _unknowns(body, np.asarray(body.rest) @ slope.T)
            read.append(np.asarray(_rows(_contact(surface, cells), body)).T @ z)
        d, tangents = np.asarray(surface.direction), np.asarray(surface.tangents)
        # Each point slides along d to the plane z = HEIGHT.
        points = CENTRE + RADIUS * np.asarray(cells.points) @ tangents
        points = points + np.outer((HEIGHT - points[:, 2]) / d[2], d)
        expected = shares(cells).T @ (points @ slope.T @ d)
        np.testing.assert_allclose(read, np.tile(expected, (3, 1)), rtol=1e-12)


def test_mean_of_a_paraboloid_under_the_disc(block) -> None:
    """Quadratic elements hold |x − c|²: its mean over a disc is a²/2, and 2 a²/3 under a rigid punch."""
    body, surface = _body(block), _surface(block, DOWN)
    away = np.asarray(body.rest) - CENTRE
    z = _unknowns(body, np.outer(np.sum(away[:, :2] ** 2, axis=1), DOWN))
    flat = _rows(_contact(surface, uniform()), body).T @ z
    np.testing.assert_allclose(flat, RADIUS**2 / 2, rtol=1e-12)
    rims, sectors = (0.6, 1.0), (3, 5)
    s = np.sqrt(1 - np.array([0.0, *rims]) ** 2)
    force = np.repeat(-np.diff(s) / sectors, sectors)
    punched = force @ (_rows(_contact(surface, flat_punch(rims, sectors)), body).T @ z)
    np.testing.assert_allclose(punched, 2 * RADIUS**2 / 3, rtol=1e-12)


@pytest.mark.parametrize("direction", [DOWN, OBLIQUE], ids=["straight", "oblique"])
def test_gradient_in_the_location_is_that_of_differences(finer, direction) -> None:
    """On a field without pattern, whose slope jumps from face to face."""
    body, surface = _body(finer), _surface(finer, direction)
    random = np.random.default_rng(3)
    z = random.normal(size=body.n)
    contact = _contact(surface, flat_punch((0.7, 1.0), (3, 5)))
    h = 1e-6 * RADIUS
    for _ in range(3):
        at = CENTRE + random.uniform(-0.3, 0.3, 3) * RADIUS
        slope = np.asarray(_slope(at, contact, body, z))
        difference = np.stack(
            [
                (_under(at + h * e, contact, body, z) - _under(at - h * e, contact, body, z)) / (2 * h)
                for e in np.eye(3)
            ],
            axis=1,
        )
        np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-7 * np.abs(slope).max())
        np.testing.assert_allclose(slope @ surface.direction, 0.0, rtol=0, atol=1e-12 * np.abs(slope).max())


def test_reading_is_continuous_where_points_cross_edges(finer) -> None:
    """Along a path of many crossings no step exceeds the steepest slope times its length."""
    body, surface = _body(finer), _surface(finer, DOWN)
    z = np.random.default_rng(4).normal(size=body.n)
    contact = _contact(surface, flat_punch((0.7, 1.0), (3, 5)))
    steps = 400
    path = CENTRE + np.linspace(-0.5, 0.5, steps + 1)[:, None] * np.array([RADIUS, 0.37 * RADIUS, 0.0])
    read = np.asarray(jax.jit(jax.vmap(lambda at: _under(at, contact, body, z)))(path))
    slopes = np.asarray(jax.jit(jax.vmap(lambda at: _slope(at, contact, body, z)))(path))
    along = np.abs(slopes @ (path[1] - path[0])).max(axis=0)
    change = np.abs(np.diff(read, axis=0)).max(axis=0)
    assert np.all(change < 1.2 * along)
    # A jump would stay when the steps get shorter; the summed slopes give the whole change.
    whole = 0.5 * (slopes[1:] + slopes[:-1]) @ (path[1] - path[0])
    np.testing.assert_allclose(whole.sum(axis=0), read[-1] - read[0], rtol=0, atol=0.02 * np.ptp(read))


def test_gradient_in_radius_and_rest_nodes_is_that_of_differences(block) -> None:
    body, surface = _body(block), _surface(block, OBLIQUE)
    z = np.random.default_rng(5).normal(size=body.n)
    cells, weight = flat_punch((0.7, 1.0), (3, 5)), np.arange(1.0, 9.0)
    move = np.random.default_rng(6).normal(size=body.rest.shape)

    @jax.jit
    def read(radius, shift):
        moved = body.with_rest(body.rest + shift * move)
        return weight @ (_rows(Contact(surface, cells, jnp.asarray(CENTRE), radius), moved).T @ z)

    slopes = jax.jit(jax.grad(read, argnums=(0, 1)))(RADIUS, 0.0)
    h = 1e-6 * RADIUS
    differences = (
        (read(RADIUS + h, 0.0) - read(RADIUS - h, 0.0)) / (2 * h),
        (read(RADIUS, h) - read(RADIUS, -h)) / (2 * h),
    )
    np.testing.assert_allclose(slopes, differences, rtol=1e-7)
    assert min(abs(float(s)) for s in slopes) > 1.0


def test_what_overhangs_an_edge_carries_nothing(block) -> None:
    """And what meets the body carries the whole of the cell's force."""
    body, surface = _body(block), _surface(block, DOWN)
    cells = uniform(rings=40, angles=128)
    where = RADIUS * np.asarray(cells.points @ surface.tangents)
    for t in (-1.1, -0.6, 0.01, 0.35, 0.8, 1.1):
        contact = _contact(surface, cells, np.array([SIZE + t * RADIUS, 0.5 * SIZE, HEIGHT]))
        inside = float(np.mean(where[:, 0] + t * RADIUS < 0))
        np.testing.assert_allclose(_overlap(contact, body), inside, rtol=0, atol=1e-14)
        nodal = _nodal(body, _rows(contact, body))
        np.testing.assert_allclose(nodal.sum(axis=(0, 2)), (t < 1) * DOWN, rtol=0, atol=1e-12)
        # It acts in the middle of the circular segment.
        c = np.clip(t, -0.999, 0.999)
        area = np.arccos(c) - c * np.sqrt(1 - c * c)
        middle = SIZE + RADIUS * (t - 2 / 3 * (1 - c * c) ** 1.5 / area)
        along = np.asarray(body.rest)[:, 0] @ (nodal.sum(axis=2) @ DOWN)
        np.testing.assert_allclose(along, (t < 1) * middle, atol=0.02 * RADIUS)
        assert not np.any(np.isnan(_slope(contact.location, contact, body, np.ones(body.n))))


def test_surface_is_what_faces_the_disc(block) -> None:
    mesh = mesh_for(QUADRATIC, block)
    for direction in (DOWN, OBLIQUE, np.array([1.0, 0.0, 0.0])):
        surface = _surface(block, direction)
        frame = np.vstack([surface.tangents, surface.direction])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), rtol=0, atol=1e-15)
        middle = mesh.nodes[np.asarray(surface.faces)[:, :3]].mean(axis=1)
        on = [
            np.isclose(middle[:, k], side).any() for k in range(3) for side in (0.0, (SIZE, SIZE, HEIGHT)[k])
        ]
        d = np.asarray(surface.direction)
        # Faces that look along an axis: seen where the direction runs against their normal.
        assert on == [bool(s * d[k] > 0.1) for k in range(3) for s in (1, -1)]
