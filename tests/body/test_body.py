"""Gravity, changed materials and rest nodes, and what a body refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import ELEMENTS, LINEAR, QUADRATIC, TAYLOR_HOOD, Body, mesh_for
from softfuse.errors import MeshError
from softfuse.material import NeoHookean
from softfuse.mesh.tetmesh import TetMesh, quadratic, tet_mesh, volumes

SIZE, LAW = 0.03, NeoHookean.from_young(6e5, 0.49)
_lagrangian, _residual = jax.jit(Body.lagrangian), jax.jit(Body.residual)


def _nodal(body: Body, z) -> np.ndarray:
    """Residual by node (k, 3) N, 0 at held nodes."""
    return np.append(np.asarray(_residual(body, z)), 0.0)[np.asarray(body.displacement_index)]


@pytest.mark.parametrize("name", sorted(ELEMENTS))
def test_weight_of_two_regions(name, irregular) -> None:
    """At rest the residual is minus the weight, whose total and centre follow from the regions' masses."""
    element = ELEMENTS[name]
    mesh = mesh_for(element, irregular(2, SIZE))
    corners = mesh.nodes[mesh.tets[:, :4]]
    region = (np.arange(len(mesh.tets)) % 3 == 0).astype(np.int32)
    mass = np.array([1070.0, 7800.0])[region] * volumes(mesh)
    gravity = np.array([0.3, -0.2, -9.81])
    held = np.all(mesh.nodes == 0.0, axis=1), np.all(mesh.nodes == SIZE, axis=1)
    force, elsewhere = (
        -_nodal(body, jnp.zeros(body.n))
        for body in (
            Body.from_mesh(
                TetMesh(mesh.nodes, mesh.tets, region),
                [LAW, LAW],
                corner,
                element=element,
                densities=(1070.0, 7800.0),
                gravity=gravity.tolist(),
            )
            for corner in held
        )
    )
    # A held corner's share of the weight does not show: take it from the body that is held elsewhere.
    force[held[0]] = elsewhere[held[0]]
    np.testing.assert_allclose(force.sum(axis=0), mass.sum() * gravity, rtol=1e-12)
    centre = mass @ corners.mean(axis=1) / mass.sum()
    moment = np.cross(mesh.nodes, force).sum(axis=0)
    np.testing.assert_allclose(moment, mass.sum() * np.cross(centre, gravity), rtol=1e-10, atol=1e-16)


def test_a_fall_releases_weight_times_height(irregular) -> None:
    mesh = irregular(2, SIZE)
    body = Body.from_mesh(
        mesh,
        [NeoHookean.from_young(1e-6, 0.3)],
        np.arange(len(mesh.nodes)) == 0,
        element=LINEAR,
        densities=[1000.0],
        gravity=(0.0, 0.0, -10.0),
    )
    drop = jnp.where(body.displacement_index == body.n, 0.0, jnp.array([0.0, 0.0, -1e-3]))
    z = jnp.zeros(body.n).at[body.displacement_index].set(drop, mode="drop")
    whole = 1000.0 * SIZE**3 * 10.0 * 1e-3
    first = np.asarray(body.tets == 0).any(axis=1)
    lost = float(jnp.sum(body.weights[first])) / 4 * 1000.0 * 10.0 * 1e-3
    np.testing.assert_allclose(_lagrangian(body, z), lost - whole, rtol=1e-6)


def test_new_materials_and_rest_nodes_are_those_of_a_new_body(irregular) -> None:
    mesh = mesh_for(TAYLOR_HOOD, irregular(2, SIZE))
    fixed = mesh.nodes[:, 2] == 0.0
    body = Body.from_mesh(mesh, [LAW], fixed)
    nodes = mesh.nodes * np.array([1.1, 0.9, 1.2])
    law = NeoHookean.from_young(1e6, 0.4)
    fresh = Body.from_mesh(TetMesh(nodes, mesh.tets, mesh.region), [law], fixed)
    changed = body.with_rest(jnp.asarray(nodes)).with_materials([law])
    z = jnp.asarray(np.random.default_rng(0).normal(size=body.n)) * 1e-4
    scaled = z.at[body.n_displacements :].multiply(body.pressure_unit / fresh.pressure_unit)
    np.testing.assert_allclose(_lagrangian(changed, z), _lagrangian(fresh, scaled), rtol=1e-12)
    moves = slice(0, body.n_displacements)
    np.testing.assert_allclose(
        _residual(changed, z)[moves], _residual(fresh, scaled)[moves], rtol=1e-9, atol=1e-12
    )


def test_region_order_does_not_matter(irregular) -> None:
    """Elements are sorted by region inside; numbering regions the other way round gives the same body."""
    mesh = irregular(2, SIZE)
    region = np.random.default_rng(0).integers(0, 2, len(mesh.tets)).astype(np.int32)
    laws = [LAW, NeoHookean.from_young(3e6, 0.3)]
    fixed = mesh.nodes[:, 2] == 0.0
    there = Body.from_mesh(TetMesh(mesh.nodes, mesh.tets, region), laws, fixed, element=LINEAR)
    back = Body.from_mesh(TetMesh(mesh.nodes, mesh.tets, 1 - region), laws[::-1], fixed, element=LINEAR)
    z = jnp.asarray(np.random.default_rng(1).normal(size=there.n)) * 1e-4
    np.testing.assert_allclose(_residual(there, z), _residual(back, z), rtol=1e-9, atol=1e-12)


def test_displacement_keeps_fixed_nodes(irregular) -> None:
    mesh = irregular(2, SIZE)
    fixed = mesh.nodes[:, 2] == 0.0
    body = Body.from_mesh(mesh, [LAW], fixed, element=LINEAR)
    u = np.asarray(body.displacement(jnp.arange(1.0, body.n + 1)))
    assert np.all(u[fixed] == 0.0)
    np.testing.assert_array_equal(u[~fixed].ravel(), np.arange(1.0, body.n + 1))


def test_what_a_body_refuses(irregular) -> None:
    mesh = irregular(1, SIZE)
    fixed = mesh.nodes[:, 2] == 0.0
    with pytest.raises(MeshError, match="order 2"):
        Body.from_mesh(mesh, [LAW], fixed)
    with pytest.raises(MeshError, match="order 1"):
        Body.from_mesh(quadratic(mesh), [LAW], np.ones(len(quadratic(mesh).nodes), bool), element=LINEAR)
    with pytest.raises(MeshError, match=r"regions \[3\]"):
        Body.from_mesh(TetMesh(mesh.nodes, mesh.tets, mesh.region + 3), [LAW], fixed, element=LINEAR)
    with pytest.raises(MeshError, match="nodes"):
        Body.from_mesh(mesh, [LAW], fixed[:-1], element=LINEAR)
    with pytest.raises(MeshError, match="no node is fixed"):
        Body.from_mesh(mesh, [LAW], np.zeros(len(fixed), bool), element=LINEAR)


def test_inside_out_elements_are_named(irregular) -> None:
    mesh = irregular(1, SIZE)
    fixed = mesh.nodes[:, 2] == 0.0
    turned = mesh.tets.copy()
    turned[4] = turned[4, [1, 0, 2, 3]]
    with pytest.raises(MeshError, match="tet 4 "):
        Body.from_mesh(tet_mesh(mesh.nodes, turned), [LAW], fixed, element=LINEAR)
    curved = quadratic(mesh)
    nodes = curved.nodes.copy()
    nodes[curved.tets[2, 4]] += 2.0 * (nodes[curved.tets[2, 3]] - nodes[curved.tets[2, 0]])
    with pytest.raises(MeshError, match="inside out"):
        bent = np.append(fixed, np.zeros(len(nodes) - len(fixed), bool))
        Body.from_mesh(TetMesh(nodes, curved.tets, curved.region), [LAW], bent, element=QUADRATIC)
