"""Element tangents assemble to the Hessian of the Lagrangian, with two materials in one body."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import ELEMENTS, Body, mesh_for
from softfuse.material import NeoHookean, Yeoh
from softfuse.mesh.tetmesh import TetMesh, linear, quadratic

_lagrangian, _residual, _action = (
    jax.jit(Body.lagrangian),
    jax.jit(Body.residual),
    jax.jit(lambda body, z, x: body.tangent_action(z)(x)),
)
SIZE = 0.02


@pytest.fixture(scope="module", params=[*((name, False) for name in sorted(ELEMENTS)), ("taylor-hood", True)])
def case(request, box):
    """A body of twelve curved tets and two materials, strained, with nonzero pressures; last one whose
    elements are stiffer or softer than these.
    """
    element = ELEMENTS[request.param[0]]
    mesh = mesh_for(element, box([np.array([0.0, 0.6, 1.0]) * SIZE, *[np.array([0.0, SIZE])] * 2]))
    region = (mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 0] > 0.6 * SIZE).astype(np.int32)
    random = np.random.default_rng(1)
    nodes = mesh.nodes + random.uniform(-0.02, 0.02, mesh.nodes.shape) * SIZE
    laws = [NeoHookean.from_young(6e5, 0.49), Yeoh.from_poisson(3e5, 3e4, -1e3, 0.4)]
    body = Body.from_mesh(
        TetMesh(nodes, mesh.tets, region),
        laws,
        mesh.nodes[:, 0] == 0.0,
        element=element,
        densities=(1000.0, 2000.0),
        gravity=(0.0, 1.0, -9.81),
    )
    if request.param[1]:
        body = body.with_factors(jnp.asarray(random.uniform(0.5, 2.0, len(mesh.tets))))
    z = random.normal(size=body.n) * 0.03 * SIZE
    z[body.n_displacements :] = random.normal(size=body.n - body.n_displacements)
    return body, jnp.asarray(z)


def test_element_tangents_assemble_to_the_hessian(case, assembled) -> None:
    body, z = case
    hessian = np.asarray(jax.jit(jax.hessian(Body.lagrangian, argnums=1))(body, z))
    np.testing.assert_allclose(assembled(body, z).toarray(), hessian, atol=1e-12 * np.abs(hessian).max())
    assert np.linalg.norm(hessian) > 0


def test_each_element_tangent_is_symmetric(case, tangents) -> None:
    every = np.asarray(tangents(*case))
    np.testing.assert_allclose(every, every.swapaxes(1, 2), atol=1e-12 * np.abs(every).max())


def test_tangent_action_is_the_hessian(case, assembled) -> None:
    body, z = case
    directions = np.random.default_rng(2).normal(size=(body.n, 3))
    expected = assembled(body, z) @ directions
    action = _action(body, z, jnp.asarray(directions))
    np.testing.assert_allclose(action, expected, atol=1e-12 * np.abs(expected).max())


def test_residual_is_the_slope_of_the_lagrangian(case) -> None:
    body, z = case
    random = np.random.default_rng(3)
    direction = random.normal(size=body.n) * np.where(np.arange(body.n) < body.n_displacements, SIZE, 1.0)
    h = 1e-6
    slope = (_lagrangian(body, z + h * direction) - _lagrangian(body, z - h * direction)) / (2 * h)
    np.testing.assert_allclose(_residual(body, z) @ direction, slope, rtol=1e-7)


def test_residual_is_the_gradient_of_the_lagrangian(case) -> None:
    body, z = case
    gradient = np.asarray(jax.jit(jax.grad(Body.lagrangian, argnums=1))(body, z))
    np.testing.assert_allclose(_residual(body, z), gradient, atol=1e-12 * np.abs(gradient).max())


def test_residual_differentiates_like_the_gradient(case) -> None:
    """In rest nodes, materials and factors, forwards and backwards."""
    body, z = case
    random = np.random.default_rng(4)
    left = jnp.asarray(random.normal(size=body.n))
    move = jnp.asarray(random.normal(size=body.rest.shape)) * 0.01 * SIZE
    stiffer = jax.tree.map(lambda leaf: 0.1 * leaf, body.materials)
    stronger = jax.tree.map(lambda leaf: jnp.asarray(random.uniform(0, 0.1, leaf.shape)), body.factors)

    def compared(gradient):
        def work(rest, materials, factors):
            changed = body.with_rest(rest).with_materials(materials)
            return left @ gradient(replace(changed, factors=factors), z)

        at, along = (body.rest, body.materials, body.factors), (move, stiffer, stronger)
        return jax.jvp(work, at, along)[1], jax.grad(work, argnums=(0, 1, 2))(*at)

    forward, backward = jax.jit(lambda: compared(Body.residual))()
    expected, by_energy = jax.jit(lambda: compared(jax.grad(Body.lagrangian, argnums=1)))()
    assert abs(float(expected)) > 0
    np.testing.assert_allclose(forward, expected, rtol=1e-10)
    for found, wanted in zip(jax.tree.leaves(backward), jax.tree.leaves(by_energy), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-11 * np.abs(wanted).max())


def test_the_saddle_is_quasi_definite_at_rest(case, assembled) -> None:
    """As many positive eigenvalues as displacements and as many negative ones as pressures."""
    body, z = case
    values = np.linalg.eigvalsh(assembled(body, 0.0 * z).toarray())
    assert np.sum(values > 0) == body.n_displacements
    assert np.sum(values < 0) == body.n - body.n_displacements


def test_mesh_order_follows_the_element(box) -> None:
    mesh = box([np.array([0.0, SIZE])] * 3)
    for element in ELEMENTS.values():
        wanted = quadratic(mesh) if element.order == 2 else linear(mesh)
        assert mesh_for(element, mesh).tets.shape == wanted.tets.shape
        assert mesh_for(element, quadratic(mesh)).order == element.order
