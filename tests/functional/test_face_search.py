"""Buckets of faces: they find what the test of every face finds, to the last bit."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import TAYLOR_HOOD, Body, mesh_for
from softfuse.functional.contact import Contact, ContactSurface, EveryFace, FaceBuckets
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mechanics.surface_ports import CellPorts
from softfuse.mesh.surface import outer_surface
from softfuse.mesh.tetmesh import TetMesh
from softfuse.robot.file import load
from softfuse.robot.mesh import build_mesh

PAD = Path(__file__).parents[2] / "configs" / "pad.toml"
DOWN, OBLIQUE = np.array([0.0, 0.0, -1.0]), np.array([0.3, -0.2, -1.0])

_land = jax.jit(lambda surface, rest, points: surface.land(rest, points))


@pytest.fixture(scope="module")
def pad() -> TetMesh:
    """The pad's own mesh."""
    return build_mesh(load(PAD)).mesh


@pytest.fixture(scope="module")
def slotted(box) -> TetMesh:
    """A block of 20 × 30 × 12 mm with a slot through it and a step: up to three faces in line."""
    keep = np.ones((4, 3, 4), bool)
    keep[1, :, 1] = keep[3, :, 3] = False
    axes = (np.linspace(0.0, size, n + 1) for size, n in zip((0.02, 0.03, 0.012), keep.shape, strict=True))
    return mesh_for(TAYLOR_HOOD, box(*axes, keep=keep))


def _facing(mesh: TetMesh, direction: np.ndarray) -> ContactSurface:
    return ContactSurface.facing(outer_surface(mesh).faces, mesh.nodes, direction)


def _exhaustive(surface: ContactSurface) -> ContactSurface:
    return dataclasses.replace(surface, search=EveryFace(len(surface.faces)))


def _crowd(surface: ContactSurface, nodes: np.ndarray) -> np.ndarray:
    """Points (p, 3) m on and around the body: at nodes, on edges and within a hair of them, anywhere."""
    random = np.random.default_rng(0)
    corners = nodes[np.asarray(surface.faces)[:, :3]]
    t = random.uniform(size=(7, len(corners), 3, 1))
    edges = (corners + t * (np.roll(corners, 1, axis=1) - corners)).reshape(-1, 3)
    size, middle = np.ptp(nodes, axis=0), nodes.mean(axis=0)
    around = middle + size * random.uniform(-0.6, 0.6, (20_000, 3))
    far = middle + 100 * size * random.normal(size=(500, 3))
    beside = edges + 1e-12 * random.normal(size=edges.shape)
    return np.concatenate([corners.reshape(-1, 3), edges, beside, around, far])


def _assert_same(surface: ContactSurface, rest: np.ndarray, points: np.ndarray) -> None:
    found, expected = (_land(each, rest, points) for each in (surface, _exhaustive(surface)))
    assert expected.met.any() and not expected.met.all()
    for name in ("met", "nodes", "shape", "slopes"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@pytest.mark.parametrize("direction", [DOWN, OBLIQUE, -OBLIQUE], ids=["down", "oblique", "up"])
@pytest.mark.parametrize("name", ["pad", "slotted"])
def test_points_land_where_the_test_of_every_face_says(name, direction, request) -> None:
    mesh = request.getfixturevalue(name)
    surface = _facing(mesh, direction)
    assert isinstance(surface.search, FaceBuckets)
    _assert_same(surface, mesh.nodes, _crowd(surface, mesh.nodes))


def test_of_faces_in_line_the_first_is_met(slotted) -> None:
    surface, nodes = _facing(slotted, DOWN), slotted.nodes
    points = _crowd(surface, nodes)
    on = _land(surface, nodes, points)
    height = np.sum(np.asarray(on.shape) * nodes[np.asarray(on.nodes), 2], axis=1)
    # The roof stands over the slot's floor, and is lower at the step.
    roof = np.where(points[:, 0] > 0.015, 0.009, 0.012)
    clear = np.asarray(on.met) & (np.abs(points[:, 0] - 0.015) > 1e-9)
    assert clear.sum() > 10_000
    np.testing.assert_allclose(height[clear], roof[clear], rtol=1e-12)


def test_few_faces_of_the_pad_are_tested(pad) -> None:
    surface = _facing(pad, DOWN)
    assert isinstance(surface.search, FaceBuckets)
    assert len(surface.faces) > 300
    assert surface.search.faces.shape[-1] <= 8


def test_every_triangle_over_a_point_is_named_in_ascending_order() -> None:
    """Triangles of all sizes and both senses, on top of each other."""
    random = np.random.default_rng(1)
    size = 10.0 ** random.uniform(-2, 0, (300, 1, 1))
    triangles = random.uniform(-1, 1, (300, 1, 2)) + size * random.normal(size=(300, 3, 2))
    points = random.uniform(-2, 2, (5000, 2))
    named = np.asarray(FaceBuckets.over(triangles).candidates(jnp.asarray(points)))
    assert named.min() >= 0 and named.max() < 300
    sides = np.roll(triangles, -1, axis=1) - triangles
    away = points[:, None, None] - triangles
    turn = sides[..., 0] * away[..., 1] - sides[..., 1] * away[..., 0]
    over = np.all(turn >= 0, axis=2) | np.all(turn <= 0, axis=2)
    assert over.any(axis=1).sum() > 1000 and not over.any(axis=1).all()
    for here, faces in zip(over, named, strict=True):
        distinct = list(dict.fromkeys(faces.tolist()))
        assert [face for face in distinct if here[face]] == np.flatnonzero(here).tolist()


def test_faces_that_move_less_than_the_margin_are_still_found(pad) -> None:
    surface, nodes = _facing(pad, OBLIQUE), pad.nodes
    corners = nodes[np.asarray(surface.faces)[:, :3]]
    flat = corners @ np.asarray(surface.tangents).T
    edges = flat[:, 1:] - flat[:, :1]
    margin = 0.25 * np.sqrt(np.mean(np.abs(np.linalg.det(edges))) / 2)
    turn = np.random.default_rng(2).uniform(0, 2 * np.pi, len(nodes))
    move = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ np.asarray(surface.tangents)
    along = np.random.default_rng(3).normal(size=(len(nodes), 1)) * np.asarray(surface.direction)
    moved = nodes + 0.999 * margin * (move + along)
    points = _crowd(surface, moved)
    _assert_same(surface, moved, points)
    # Much farther away they are not: a new search is needed then, as is said.
    moved = nodes + 8 * margin * np.asarray(surface.tangents)[0]
    with pytest.raises(AssertionError, match="met"):
        _assert_same(surface, moved, _crowd(surface, moved))
    _assert_same(_facing(dataclasses.replace(pad, nodes=moved), OBLIQUE), moved, _crowd(surface, moved))


@pytest.mark.parametrize("direction", [DOWN, OBLIQUE], ids=["straight", "oblique"])
def test_rows_and_their_slopes_are_those_of_the_test_of_every_face(slotted, direction) -> None:
    """At many places at once, as a robot looks at them, overhanging ones among them."""
    law, held = NeoHookean.from_young(1e5, 0.4), slotted.nodes[:, 2] == 0.0
    body = Body.from_mesh(slotted, [law], held, element=TAYLOR_HOOD)
    bucketed = Contact(
        _facing(slotted, direction), flat_punch((0.7, 1.0), (3, 5)), jnp.zeros(3), jnp.array(4e-3)
    )
    exhaustive = dataclasses.replace(bucketed, surface=_exhaustive(bucketed.surface))
    places = jnp.asarray(np.random.default_rng(4).uniform(-2e-3, 32e-3, (60, 3)))
    z = np.random.default_rng(5).normal(size=body.n)

    @jax.jit
    def rows_and_slopes(contact):
        def under(place):
            rows = CellPorts.of(dataclasses.replace(contact, location=place), body).slopes
            return rows.T @ z, rows

        return jax.vmap(jax.jacfwd(under, has_aux=True))(places)

    (slopes, rows), expected = rows_and_slopes(bucketed), rows_and_slopes(exhaustive)
    assert np.abs(slopes).max() > 1.0
    np.testing.assert_array_equal(rows, expected[1])
    np.testing.assert_allclose(slopes, expected[0], rtol=0, atol=1e-15 * np.abs(slopes).max())
