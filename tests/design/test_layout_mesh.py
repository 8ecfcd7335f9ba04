"""Meshes that follow a layout: on its surfaces, symmetric, of the right volume, differentiable, replaced."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from softfuse.errors import MeshError
from softfuse.functional.cavity import Cavity
from softfuse.mesh.block import Fineness, finer_to_the_top
from softfuse.mesh.orientation import check
from softfuse.mesh.pad import PadGeometry
from softfuse.mesh.quality import curved_mean_ratios, mean_ratios
from softfuse.mesh.surface import outer_surface
from softfuse.mesh.tetmesh import TetMesh, quadratic, tet_mesh
from softfuse.robot.layout.cavity_shape import CavityShape
from softfuse.robot.layout.layout import TiedLayout
from softfuse.robot.layout.layout_mesh import layout_mesh, remade
from softfuse.robot.layout.profile import FreeForm, RoundedBox, Superellipsoid


def volume(made, theta, k: int = 0) -> float:
    return float(Cavity(jnp.asarray(made.walls[k].faces))(made.rest(jnp.asarray(theta))))


def test_walls_lie_on_the_surfaces_and_the_skin_stays(twins, twin_mesh, changed) -> None:
    made, before, after = twin_mesh, twin_mesh.mesh(twins.start), twin_mesh.mesh(changed)
    check(before)
    np.testing.assert_array_equal(after.tets, before.tets)
    skin = outer_surface(before).faces
    np.testing.assert_array_equal(after.nodes[skin], np.asarray(made.boxes)[skin])
    assert {-0.035, 0.035} <= set(after.nodes[:, 0].round(12)) and after.nodes[:, 2].max() == 0.018
    values = twins.values(jnp.asarray(changed))
    corners = np.unique(made.walls[1].faces[:, :3])
    fillet, half = float(values[1][9]), np.asarray(values[1][3:6])
    angle = float(values[1][8])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    local = (after.nodes[corners] - np.asarray(values[1][:3])) @ turn
    apart = np.linalg.norm(local - np.clip(local, fillet - half, half - fillet), axis=1)
    # Farther out by what makes up for the volume that flat faces cut off.
    grown = float(made.grown[1])
    assert 0 < grown < 0.15e-3
    assert (apart > fillet).all() and (apart < fillet + np.sqrt(3.0) * grown).all()


def test_mirrored_cavities_have_mirrored_nodes(twin_mesh, changed) -> None:
    nodes = twin_mesh.mesh(changed).nodes
    assert cKDTree(nodes).query(nodes * [-1.0, 1.0, 1.0])[0].max() < 1e-9


@pytest.mark.parametrize(
    ("profile", "shape"),
    [
        (RoundedBox(), {"fillet": 0.0003}),
        (RoundedBox(), {"fillet": 0.0028}),
        (Superellipsoid(), {"roundness": 0.3}),
        (Superellipsoid(), {"roundness": 1.0}),
        (FreeForm(RoundedBox(), 2), {"fillet": 0.001, "harmonic 2 2": 0.05}),
    ],
)
def test_every_profile_is_meshed_well(profile, shape, layout_like, fineness) -> None:
    layout = layout_like(profile, **shape)
    made = layout_mesh(layout, layout.start, fineness)
    assert made.quality(layout.start) == made.made_quality > 0.1
    assert not made.worn(layout.start)


def test_meshes_have_the_cavitys_volume_and_need_to_grow_it_ever_less() -> None:
    block = PadGeometry((0.03, 0.03, 0.02), (0.016, 0.014, 0.008), ((0.0, 0.0),), 0.006).block()
    values = {"x": 0.0, "y": 0.0, "z": 0.01, "half x": 0.008, "half y": 0.007, "half z": 0.004}
    ball = CavityShape(Superellipsoid()), {**values, "roundness": 1.0}
    layout = TiedLayout.of(block, [ball], [])
    exact = 4 / 3 * np.pi * 0.008 * 0.007 * 0.004
    grown = []
    for size in (0.012, 0.006, 0.003):
        made = layout_mesh(layout, layout.start, Fineness(size, finer_to_the_top(0.02, size)))
        assert volume(made, layout.start) == pytest.approx(exact, rel=5e-4)
        grown.append(abs(float(made.grown[0])))
    assert grown[0] < 0.5e-3
    assert grown[2] < 0.5 * grown[1] < 0.25 * grown[0]


def test_nodes_have_the_derivatives_of_differences(twins, twin_mesh, changed) -> None:
    rest, at = jax.jit(lambda theta: twin_mesh.rest(theta)), jnp.asarray(changed)
    slope = jax.jacfwd(rest)(at)
    weights = jnp.asarray(np.random.default_rng(0).normal(size=twin_mesh.boxes.shape))
    (backward,) = jax.vjp(rest, at)[1](weights)
    np.testing.assert_allclose(jnp.einsum("ni,nip->p", weights, slope), backward, rtol=1e-10)
    for k, step in enumerate(1e-4 * twins.scale):
        difference = (rest(at.at[k].add(step)) - rest(at.at[k].add(-step))) / (2 * step)
        np.testing.assert_allclose(slope[..., k], difference, atol=1e-6 * np.abs(difference).max() + 1e-9)


def test_a_worn_mesh_is_replaced_by_a_better_one(twins, twin_mesh, fineness) -> None:
    far = twins.start.copy()
    far[1:4] = 0.0145, 0.0038, 0.013
    assert twin_mesh.worn(far) and not twin_mesh.worn(twins.start)
    fresh = layout_mesh(twins, far, fineness)
    assert fresh.quality(far) > 1.5 * twin_mesh.quality(far) and not fresh.worn(far)
    # The same parameters describe the same cavities.
    assert volume(fresh, far) == pytest.approx(volume(twin_mesh, far), rel=0.03)


def test_what_cannot_be_meshed_is_told(twins, fineness) -> None:
    wide = twins.start.copy()
    wide[twins.names.index("turn")] = 0.8
    with pytest.raises(MeshError, match="turned inside out"):
        layout_mesh(twins, wide, fineness)
    high = twins.start.copy()
    high[twins.names.index("level")] += 0.01
    with pytest.raises(MeshError, match="reaches the surface"):
        layout_mesh(twins, high, fineness)
    flat = twins.start.copy()
    flat[twins.names.index("half height")] = 0.0005
    with pytest.raises(MeshError, match="fillets smaller"):
        layout_mesh(twins, flat, fineness)


def _one() -> TetMesh:
    return tet_mesh([[0.0, 0, 0], [1, 0, 0], [0.2, 1, 0], [0, 0.1, 0.7]], [[0, 1, 2, 3]])


def test_curved_tetrahedra_are_judged_by_their_smallest_jacobian() -> None:
    mesh = quadratic(_one())
    np.testing.assert_allclose(curved_mean_ratios(mesh), mean_ratios(mesh), rtol=1e-12)
    bent = mesh.nodes.copy()
    # A middle node at a quarter of the edge makes the Jacobian 0 at the edge's end.
    bent[mesh.tets[0, 4]] = [0.25, 0.0, 0.0]
    assert curved_mean_ratios(tet_mesh(bent, mesh.tets))[0] == pytest.approx(0.0, abs=1e-9)
    bent[mesh.tets[0, 4]] = [0.2, 0.0, 0.0]
    assert curved_mean_ratios(tet_mesh(bent, mesh.tets))[0] < 0


def test_a_mesh_made_anew_for_the_same_parameters_is_the_same(twins, twin_mesh, fineness) -> None:
    again = remade(twin_mesh, twins.start, fineness)
    assert again.tets is twin_mesh.tets
    rest = [mesh.rest(jnp.asarray(twins.start)) for mesh in (again, twin_mesh)]
    np.testing.assert_allclose(rest[0], rest[1], rtol=0, atol=1e-10)


def test_a_mesh_made_anew_has_the_same_tetrahedra_in_better_shape(twins, twin_mesh, fineness) -> None:
    theta = twins.start + 2.0 * twins.scale * (np.array(twins.names) == "width")
    again = remade(twin_mesh, theta, fineness)
    assert again.tets is twin_mesh.tets
    assert again.quality(theta) >= twin_mesh.quality(theta)
    for k in range(2):
        assert volume(again, theta, k) == pytest.approx(volume(twin_mesh, theta, k), rel=0.01)


def test_a_mesh_whose_boxes_change_their_order_has_other_tetrahedra(twins, twin_mesh, fineness) -> None:
    theta = np.where(np.array(twins.names) == "width", 0.004, twins.start)
    assert remade(twin_mesh, theta, fineness).tets is not twin_mesh.tets
