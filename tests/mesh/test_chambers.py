"""Chambers from files beside a body, and open ones closed by a cap."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from softfuse.body import LINEAR, Body
from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity, rim_edges
from softfuse.material import NeoHookean
from softfuse.mechanics.volume import VolumePorts
from softfuse.mesh.chambers import check_fit, hollowed, open_void
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.overlap import outline
from softfuse.mesh.shell import Shell, checked, shell_parts
from softfuse.mesh.surface import Surface, cavities, enclosed_volume
from softfuse.mesh.tetmesh import TetMesh, quadratic, tet_mesh

MM = 1e-3


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Manifold:
    size = np.subtract(high, low)
    return Manifold.cube(size.tolist()).translate(list(low))


def shell(of: Manifold) -> Shell:
    nodes, faces = outline(of)
    return checked(MM * nodes, faces)


BODY = box((0, 0, 0), (30, 12, 12))
CHAMBERS = [box((4, 3, 3), (10, 9, 9)), box((16, 3, 3), (26, 9, 9))]


def test_a_body_is_hollowed_by_chambers_and_keeps_voids_that_it_has() -> None:
    expected = MM**3 * (BODY.volume() - sum(each.volume() for each in CHAMBERS))
    for body in (BODY, BODY - CHAMBERS[0], BODY - CHAMBERS[0] - CHAMBERS[1]):
        made = hollowed(shell(body), [shell(each) for each in CHAMBERS])
        assert enclosed_volume(made.nodes, made.faces) == pytest.approx(expected, rel=1e-9)
        assert len(shell_parts(made)) == 3


def test_a_chamber_that_does_not_fit_is_told() -> None:
    outside = shell(CHAMBERS[0].translate([-8, 0, 0]))
    with pytest.raises(
        MeshError, match=r"chamber 1 around \[-1.0, 6.0, 6.0\] mm has 144 of its 216 mm³ outside"
    ):
        hollowed(shell(BODY), [shell(CHAMBERS[1]), outside])
    with pytest.raises(MeshError, match="chamber 0 has several parts"):
        hollowed(shell(BODY), [shell(CHAMBERS[0] + CHAMBERS[1])])


def hollow(*, x: int, opened: bool) -> TetMesh:
    """A block of 10 x 6 x 6 boxes of 1 mm with a void of x * 2 * 2, open at x = 0 or not."""
    keep = np.ones((10, 6, 6), bool)
    keep[0 if opened else 2 : 2 + x, 2:4, 2:4] = False
    planes = tuple(MM * np.arange(n + 1.0) for n in keep.shape)
    grid = kuhn_grid(planes, keep, (0, 0, 0))
    return oriented(tet_mesh(grid.nodes, grid.tets))


def test_the_void_of_a_mesh_has_to_fit_the_chambers_file() -> None:
    mesh = hollow(x=4, opened=False)
    (wall,) = cavities(mesh)
    check_fit(mesh, wall, shell(box((2, 2, 2), (6, 4, 4))))
    with pytest.raises(MeshError, match=r"void of 16 mm³ .* surface of 24 mm³ is up to 1 mm off it"):
        check_fit(mesh, wall, shell(box((2, 2, 2), (8, 4, 4))))


INSIDE, MOUTH, OUTWARDS = MM * np.array([3.0, 3, 3]), MM * np.array([0.0, 3, 3]), np.array([-2.0, 0, 0])


def opened(order: int = 1) -> tuple[TetMesh, Surface]:
    mesh = hollow(x=4, opened=True)
    mesh = mesh if order == 1 else quadratic(mesh)
    return mesh, open_void(mesh, INSIDE, MOUTH, OUTWARDS)


@pytest.mark.parametrize("order", [1, 2])
def test_an_open_void_is_closed_by_a_cap_over_its_rim(order: int) -> None:
    mesh, wall = opened(order)
    assert len(np.unique(rim_edges(wall.faces))) == 8
    volume = Cavity.of(wall.faces)
    assert float(volume(jnp.asarray(mesh.nodes))) == pytest.approx(24 * MM**3, rel=1e-12)


def test_the_skin_around_a_mouth_need_not_be_flat() -> None:
    """A mesher leaves it within its envelope: here up to a tenth of an edge behind the mouth's plane."""
    mesh = hollow(x=4, opened=True)
    nodes, off = mesh.nodes.copy(), np.random.default_rng(1)
    around = nodes[:, 0] == 0.0
    nodes[around, 0] += off.uniform(0.0, 0.1 * MM, around.sum())
    wall = open_void(tet_mesh(nodes, mesh.tets), INSIDE, MOUTH, OUTWARDS)
    assert len(wall.faces) == len(opened()[1].faces)


def test_the_capped_volume_does_not_change_when_the_body_moves_and_follows_its_stretch() -> None:
    mesh, wall = opened(2)
    volume = Cavity.of(wall.faces)
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    moved = mesh.nodes @ turn.T + np.array([0.3, -0.2, 0.1])
    assert float(volume(jnp.asarray(moved))) == pytest.approx(24 * MM**3, rel=1e-9)
    stretched = mesh.nodes * np.array([1.5, 0.9, 1.2])
    assert float(volume(jnp.asarray(stretched))) == pytest.approx(24 * 1.62 * MM**3, rel=1e-12)
    # A closed surface has the same volume about any origin, so pressure pulls at it with no net force.
    force = jax.grad(volume)(jnp.asarray(mesh.nodes))
    np.testing.assert_allclose(jnp.sum(force, axis=0), 0.0, atol=1e-12 * MM**2)


def test_the_pressure_on_a_cap_goes_to_its_rim() -> None:
    """On the walls alone it would push with p times the mouth's area along outwards' opposite."""
    mesh, wall = opened()
    force = np.asarray(jax.grad(Cavity.of(wall.faces))(jnp.asarray(mesh.nodes)))
    rim = np.unique(rim_edges(wall.faces))
    alone = np.asarray(jax.grad(Cavity(jnp.asarray(wall.faces)))(jnp.asarray(mesh.nodes)))
    away = np.setdiff1d(np.arange(len(force)), rim)
    np.testing.assert_allclose(force[away], alone[away], atol=1e-15)
    np.testing.assert_allclose(force[away].sum(axis=0) + force[rim].sum(axis=0), 0.0, atol=1e-15)


def body_of(mesh: TetMesh, held: np.ndarray) -> Body:
    return Body.from_mesh(mesh, [NeoHookean.from_young(1e5, 0.4)], held, element=LINEAR)


def test_gas_needs_a_rim_that_is_held_and_its_stiffness_is_the_slope_of_its_force() -> None:
    mesh, wall = opened()
    cavity = Cavity.of(wall.faces)
    with pytest.raises(MeshError, match=r"opens at \[0.0, 3.0, 3.0\] mm can move"):
        VolumePorts.of((cavity,), body_of(mesh, mesh.nodes[:, 0] > 9.5 * MM))
    body = body_of(mesh, mesh.nodes[:, 0] < 0.5 * MM)
    ports = VolumePorts.of((cavity,), body)
    rng = np.random.default_rng(1)
    z, along = (1e-4 * jnp.asarray(rng.normal(size=body.n)) for _ in range(2))
    force = eqx.filter_jit(lambda x: ports.rows(body, x)[:, 0])
    slope = (force(z + 1e-3 * along) - force(z - 1e-3 * along)) / 2e-3
    tangents = ports.stiffen(body, z, jnp.array([-1.0]), jnp.zeros_like(body.element_tangents(z)))
    index = np.asarray(body.element_unknowns)
    padded = np.append(along, 0.0)
    product = np.zeros(body.n + 1)
    np.add.at(product, index, np.einsum("eij,ej->ei", tangents, padded[index]))
    np.testing.assert_allclose(product[:-1], slope, rtol=1e-6, atol=1e-9 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("x", "inside", "outwards", "told"),
    [
        (4, INSIDE, -OUTWARDS, "no wall of an open void is seen"),
        (8, INSIDE, OUTWARDS, "opens at 2 places .* it needs one mouth"),
    ],
)
def test_a_mouth_that_cannot_be_is_told(x: int, inside, outwards, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        open_void(hollow(x=x, opened=True), inside, MOUTH, outwards)
