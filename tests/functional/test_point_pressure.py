"""Hydrostatic pressure at a place: uniform states of every element in closed form, gradients, and the same on
a reduced body.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import ELEMENTS, Body, mesh_for
from softfuse.errors import MeshError
from softfuse.functional.point_pressure import PointPressure
from softfuse.material import NeoHookean, Yeoh

MU, LAME = 4e4, 3e5
PLANES = tuple(1e-3 * np.array(p, float) for p in ([0, 9, 20], [0, 11, 20], [0, 8, 20]))
MIDDLE = np.array([0.0105, 0.0095, 0.0085])
_value = jax.jit(lambda functional, body, z: functional.value(body, z))


def _body(box, element, laws, factors=None) -> Body:
    """A cube held at one corner, whose upper half is of the last law."""
    mesh = mesh_for(ELEMENTS[element], box(*PLANES))
    mesh.region[:] = (mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 2] > PLANES[2][1]) * (len(laws) - 1)
    corner = np.all(mesh.nodes == 0.0, axis=1)
    body = Body.from_mesh(mesh, laws, corner, element=ELEMENTS[element])
    return body if factors is None else body.with_factors(jnp.full(len(body.tets), factors))


def _state(body: Body, a: np.ndarray, pressure: float) -> jnp.ndarray:
    """Unknowns where x = A X everywhere, and every pressure node has that pressure [Pa]."""
    z = np.full(body.n + 1, pressure / float(body.pressure_unit))
    z[np.asarray(body.displacement_index)] = np.asarray(body.rest) @ (a - np.eye(3)).T
    return jnp.asarray(z[:-1])


def _neo_hookean(a: np.ndarray, mu: float, mean: float) -> float:
    """−tr σ/3 [Pa] of W_d = μ/2 (tr C − 3 − 2 ln J) with ∂W/∂ln J = `mean` of the volumetric part."""
    j = np.linalg.det(a)
    return -(mu / 3 * (np.trace(a.T @ a) - 3) + mean) / j


A = np.array([[1.1, 0.2, 0.0], [0.05, 0.95, -0.1], [0.0, 0.1, 1.02]])


@pytest.mark.parametrize(("element", "factor"), [("linear", None), ("quadratic", 1.7)])
def test_pressure_of_a_uniform_strain(box, element, factor) -> None:
    body = _body(box, element, [NeoHookean(MU, LAME)], factor)
    found = _value(PointPressure.of(body, MIDDLE, 0.004), body, _state(body, A, 0.0))
    expected = (factor or 1.0) * _neo_hookean(A, MU, LAME * np.log(np.linalg.det(A)))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_hydrostatic_state_of_mixed_elements(box) -> None:
    """An incompressible solid under all-round pressure: only the pressure unknown knows; and the mean of two
    materials that the ball reaches into, of which one is strained more than the other's law says.
    """
    body = _body(box, "taylor-hood", [NeoHookean(MU, 1e9)])
    barometer = PointPressure.of(body, MIDDLE, 0.004)
    np.testing.assert_allclose(_value(barometer, body, _state(body, np.eye(3), -1e4)), 1e4, rtol=1e-12)
    expected = _neo_hookean(A, MU, -1e4)
    np.testing.assert_allclose(_value(barometer, body, _state(body, A, -1e4)), expected, rtol=1e-12)
    both = _body(box, "taylor-hood", [NeoHookean(MU, 1e9), NeoHookean(3 * MU, 1e9)])
    across = PointPressure.of(both, np.array([0.0105, 0.0095, PLANES[2][1] + 1e-4]), 0.004)
    upper = np.mean(np.asarray(across.points.location)[:, 2] > PLANES[2][1])
    assert 0.2 < upper < 0.8
    parts = (1 - upper) * _neo_hookean(A, MU, -1e4) + upper * _neo_hookean(A, 3 * MU, -1e4)
    np.testing.assert_allclose(_value(across, both, _state(both, A, -1e4)), parts, rtol=1e-12)


def test_pressure_is_none_at_rest_and_rigid_motions_keep_it(box) -> None:
    body = _body(box, "taylor-hood", [Yeoh(10e3, 140.0, -4.0, 1e7)])
    barometer = PointPressure.of(body, MIDDLE, 0.004)
    np.testing.assert_allclose(_value(barometer, body, jnp.zeros(body.n)), 0.0, atol=1e-10)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    still, turned = (_value(barometer, body, _state(body, r @ A, -3e3)) for r in (np.eye(3), turn))
    np.testing.assert_allclose(turned, still, rtol=1e-12)


def test_pressure_has_the_slope_of_differences(box) -> None:
    body, random = _body(box, "taylor-hood", [NeoHookean(MU, 1e7)]), np.random.default_rng(2)
    barometer = PointPressure.of(body, MIDDLE, 0.004)
    z = _state(body, A, -1e3) + 1e-4 * random.normal(size=body.n)
    direction, h = random.normal(size=body.n), 1e-7
    slope = jax.grad(lambda z: barometer.change(body, z))(z) @ direction
    ends = (float(_value(barometer, body, z + sign * h * direction)) for sign in (1, -1))
    np.testing.assert_allclose(slope, np.subtract(*ends) / (2 * h), rtol=1e-6)


def test_ball_that_leaves_the_body_is_told(box) -> None:
    body = _body(box, "linear", [NeoHookean(MU, LAME)])
    with pytest.raises(MeshError, match=r"point of the patch \d+ at .* lies? outside the body by"):
        PointPressure.of(body, np.array([0.001, 0.01, 0.01]), 0.004)
