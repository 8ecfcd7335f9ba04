"""Elements that are stiffer than their material, and the smooth field that says by how much."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import ELEMENTS, LINEAR, Body, mesh_for
from softfuse.body.stiffness_field import TERMS, field_terms, with_field
from softfuse.material import NeoHookean, Yeoh

SIZE = 0.02
LAWS = {"neo-hookean": NeoHookean.from_young(6e5, 0.49), "yeoh": Yeoh.from_poisson(3e5, 3e4, -1e3, 0.4)}


@pytest.fixture(params=sorted(ELEMENTS))
def body(request, irregular) -> Body:
    element = ELEMENTS[request.param]
    mesh = mesh_for(element, irregular(1, SIZE))
    return Body.from_mesh(mesh, [LAWS["yeoh"]], mesh.nodes[:, 0] == 0.0, element=element)


def _strained(body: Body) -> jax.Array:
    random = np.random.default_rng(1)
    z = random.normal(size=body.n) * 0.03 * SIZE
    z[body.n_displacements :] = random.normal(size=body.n - body.n_displacements)
    return jnp.asarray(z)


def test_a_factor_that_is_the_same_everywhere_is_one_on_all_moduli(body: Body) -> None:
    @jax.jit
    def answers(body, z):
        return body.lagrangian(z), body.residual(z), body.element_tangents(z)

    z = _strained(body)
    scaled = answers(body.with_materials([law.times(1.3) for law in body.materials]), z)
    stiffer = answers(body.with_factors(jnp.full(len(body.tets), 1.3)), z)
    for found, expected in zip(stiffer, scaled, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    assert not np.allclose(stiffer[0], answers(body, z)[0], rtol=0.1)


@pytest.mark.parametrize("law", sorted(LAWS))
@pytest.mark.parametrize("name", sorted(ELEMENTS))
def test_each_element_answers_as_if_it_were_of_its_own_material(name: str, law: str, irregular) -> None:
    element, material = ELEMENTS[name], LAWS[law]
    mesh = mesh_for(element, irregular(1, SIZE))
    body = Body.from_mesh(mesh, [material], mesh.nodes[:, 0] == 0.0, element=element)
    factors = np.linspace(0.5, 2.0, len(mesh.tets))
    (region,) = body.with_factors(jnp.asarray(factors)).regions()
    slopes, pressure = region.strains(jnp.append(_strained(body), 0.0))
    f = region.deformation(slopes)
    found = region.density(f, pressure)
    for k, factor in enumerate(factors):
        own = material.times(factor)
        expected = element.density(*own.measures(f), own.lame, pressure)
        np.testing.assert_allclose(found[:, k], expected[:, k], rtol=1e-12)


def test_a_field_is_a_polynomial_over_the_box(irregular) -> None:
    mesh = irregular(2, SIZE)
    body = Body.from_mesh(mesh, [LAWS["yeoh"]], mesh.nodes[:, 0] == 0.0, element=LINEAR)
    assert TERMS == ("x", "y", "z", "xy", "xz", "yz", "xx", "yy", "zz")
    x, y, z = np.transpose(2 * mesh.nodes[mesh.tets].mean(axis=1) / SIZE - 1)
    expected = (
        0.1 * x
        + 0.2 * y
        + 0.3 * z
        + 0.4 * x * y
        + 0.5 * x * z
        + 0.6 * y * z
        + 0.7 * (3 * x**2 - 1) / 2
        + 0.8 * (3 * y**2 - 1) / 2
        + 0.9 * (3 * z**2 - 1) / 2
    )
    made = with_field(body, 0.1 * jnp.arange(1.0, 10.0))
    np.testing.assert_allclose(np.log(made.factors), expected, rtol=1e-12)
    # Moved and three times as large it has the same.
    moved = body.with_rest(3.0 * body.rest + jnp.array([1.0, -2.0, 3.0]))
    np.testing.assert_allclose(field_terms(moved), field_terms(body), atol=1e-12)
