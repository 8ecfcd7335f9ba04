"""A thick sphere, held outside and inflated inside: Lamé's solution, and gas that is sealed in.

u(r) = A r + C / r² with u(b) = 0 and σ_r(a) = −p: A = −p / (3λ + 2μ + 4μ b³/a³), C = −A b³ (Timoshenko and
Goodier, Theory of Elasticity, 1970, § 136), for a pressure that strains little; compared is ΔV/V = 3 u(a)/a =
p / k. Gas of absolute pressure P₀ at rest pushes with p = P₀ ((V + V_d) / (V + ΔV + V_d))^κ − p_atm, so that
k ΔV/V = p is one scalar equation.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from softfuse.body import TAYLOR_HOOD, Body
from softfuse.functional import Cavity
from softfuse.material import NeoHookean
from softfuse.mechanics import RESULTS, Loads, Newton, PrescribedForce, Solution, State, solve
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.linearised import loaded_tangents, stiffness_map
from softfuse.mechanics.sparse import SparseLU
from softfuse.mechanics.volume import VolumePorts
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.surface import cavities
from softfuse.mesh.tetmesh import quadratic, tet_mesh

INNER, OUTER, YOUNG, ATMOSPHERE = 5e-3, 10e-3, 1e5, 101325.0
_solve = eqx.filter_jit(solve)


class Sphere(NamedTuple):
    body: Body
    cavity: Cavity
    rest_volume: float
    newton: Newton


@pytest.fixture(scope="module")
def sphere():
    """sphere(layers, poisson): so many layers of boxes between the spheres, the outer one held."""
    built: dict[tuple[int, float], Sphere] = {}

    def build(layers: int, poisson: float) -> Sphere:
        if (layers, poisson) not in built:
            side = np.linspace(INNER, OUTER, layers + 1)
            planes = np.concatenate([-side[::-1], np.linspace(-INNER, INNER, 2 * layers + 1)[1:-1], side])
            middle = 0.5 * (planes[1:] + planes[:-1])
            inside = np.abs(middle) < INNER
            keep = ~(inside[:, None, None] & inside[:, None] & inside)
            cube = kuhn_grid((planes, planes, planes), keep, (0, 0, 0))
            mesh = quadratic(oriented(tet_mesh(cube.nodes, cube.tets)))
            # Cubes become spheres, mid-edge nodes included: the largest coordinate becomes the radius.
            largest, length = np.abs(mesh.nodes).max(axis=1), np.linalg.norm(mesh.nodes, axis=1)
            shell = np.abs(largest - OUTER) < 1e-9
            mesh = tet_mesh(mesh.nodes * (largest / length)[:, None], mesh.tets)
            body = Body.from_mesh(mesh, [NeoHookean.from_young(YOUNG, poisson)], shell, element=TAYLOR_HOOD)
            cavity = Cavity(jnp.asarray(cavities(mesh, np.zeros((1, 3)))[0].faces))
            newton = Newton(SparseLU.plan(body))
            built[layers, poisson] = Sphere(body, cavity, float(cavity(body.rest)), newton)
        return built[layers, poisson]

    return build


def _swollen(sphere: Sphere, load, drive: float) -> tuple[float, Solution]:
    """ΔV / V of the cavity under one load."""
    loads = Loads((load,))
    found = _solve(sphere.newton, sphere.body, loads, jnp.array([drive]), State.rest(sphere.body, loads))
    assert found.result == RESULTS.converged
    volume = sphere.cavity(sphere.body.rest + sphere.body.displacement(found.state.z))
    return float(volume) / sphere.rest_volume - 1, found


def _inflated(sphere: Sphere, pressure: float) -> float:
    ports = VolumePorts.of((sphere.cavity,), sphere.body)
    return _swollen(sphere, PrescribedForce.on(ports, sphere.body, jnp.full(1, 1e3)), pressure)[0]


def _gas(sphere: Sphere, dead: float, exponent: float) -> SealedGas:
    return SealedGas.of((sphere.cavity,), sphere.body, jnp.array([dead]), exponent=exponent)


def _stiffness(poisson: float) -> float:
    """k [Pa] of p = k ΔV/V after Lamé."""
    mu, lame = YOUNG / 2 / (1 + poisson), YOUNG * poisson / (1 + poisson) / (1 - 2 * poisson)
    ratio = (OUTER / INNER) ** 3
    return (3 * lame + 2 * mu + 4 * mu * ratio) / 3 / (ratio - 1)


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_a_sphere_swells_as_lame_says(sphere, poisson: float) -> None:
    pressure = 1.0  # Pa, 1e-5 of E: strains whose squares do not matter
    exact = pressure / _stiffness(poisson)
    coarse, fine = (_inflated(sphere(layers, poisson), pressure) / exact - 1 for layers in (1, 2))
    assert abs(fine) < 0.03
    assert abs(fine) < 0.5 * abs(coarse)


@pytest.mark.slow
@pytest.mark.parametrize("dead_over_rest, exponent", [(0.0, 1.0), (2.0, 1.0), (0.5, 1.4)])
def test_sealed_gas_and_the_sphere_share_the_overpressure(sphere, dead_over_rest, exponent) -> None:
    """Gas sealed in 50 Pa above the atmosphere gives most of it up to its own expansion: E is that of air."""
    ball = sphere(2, 0.3)
    swollen, found = _swollen(
        ball, _gas(ball, dead_over_rest * ball.rest_volume, exponent), ATMOSPHERE + 50.0
    )

    def balance(stiffness):
        def left(v):
            gas = (ATMOSPHERE + 50.0) * ((1 + dead_over_rest) / (1 + v + dead_over_rest)) ** exponent
            return gas - ATMOSPHERE - stiffness * v

        return brentq(left, -0.1, 0.1, xtol=1e-16)

    # With the mesh's own stiffness to the last digits that a linear sphere allows, with Lamé's to the mesh's.
    own = 1.0 / _inflated(ball, 1.0)
    assert swollen == pytest.approx(balance(own), rel=2e-3)
    assert swollen == pytest.approx(balance(_stiffness(0.3)), rel=0.03)
    assert swollen < 0.8 * 50.0 / own  # without the gas giving way it would have been this
    assert float(found.state.force[0]) == pytest.approx(own * swollen, rel=2e-3)


def test_gas_sealed_at_rest_does_nothing(sphere) -> None:
    ball = sphere(1, 0.3)
    swollen, found = _swollen(ball, _gas(ball, 0.0, 1.0), ATMOSPHERE)
    assert abs(swollen) < 1e-14 and abs(float(found.state.force[0])) < 1e-8


@pytest.mark.slow
def test_stiff_walls_make_both_ways_from_volume_to_pressure_agree(sphere) -> None:
    """A wall that is drawn in squeezes the gas: it resists (coupled), or its pressure follows from the volume
    that it would have if it did not (eqs. 5 to 7). These differ as gas and wall share the load, k_gas / k.
    """
    soft = sphere(1, 0.3)
    apart = []
    for stiffer in (1e2, 1e3, 1e4):
        wall = (NeoHookean.from_young(stiffer * YOUNG, 0.3),)
        body = eqx.tree_at(lambda b: b.materials, soft.body, wall)
        ball = soft._replace(body=body, newton=Newton(SparseLU.plan(body)))
        drawn = PrescribedForce.on(VolumePorts.of((ball.cavity,), body), body, jnp.full(1, 1e3))
        gas = _gas(ball, 0.5 * ball.rest_volume, 1.4)
        suction = -0.01 * stiffer * YOUNG
        alone, _ = _swollen(ball, drawn, suction)
        loads = Loads((drawn, gas))
        at = jnp.array([suction, ATMOSPHERE])
        found = _solve(ball.newton, body, loads, at, State.rest(body, loads))
        assert found.result == RESULTS.converged
        # With half of its volume besides, dead.
        follows = ATMOSPHERE * np.expm1(-1.4 * np.log1p(alone / 1.5))
        coupled = float(found.state.force[1])
        assert coupled > 100.0  # what is drawn in squeezes
        apart.append(float(follows) / coupled - 1)
        share = 1.4 * ATMOSPHERE / 1.5 / (stiffer * _stiffness(0.3))
        assert apart[-1] == pytest.approx(share, rel=0.2)
    np.testing.assert_allclose(np.divide(apart[:-1], apart[1:]), 10.0, rtol=0.05)


def test_a_following_pressure_adds_its_second_derivative_to_the_tangent(sphere) -> None:
    """Element tangents under pressure, assembled, against differences of the balance."""
    ball = sphere(1, 0.3)
    ports = VolumePorts.of((ball.cavity,), ball.body)
    loads = Loads((PrescribedForce.on(ports, ball.body, jnp.ones(1)),))
    state = eqx.tree_at(lambda s: s.force, State.rest(ball.body, loads), jnp.array([2e4]))
    random = np.random.default_rng(0)
    z = jnp.asarray(1e-4 * random.normal(size=ball.body.n))
    state = eqx.tree_at(lambda s: s.z, state, z)
    directions = jnp.asarray(random.normal(size=(ball.body.n, 2)))
    exact = jax.jit(lambda x: stiffness_map(ball.body, loads, state)(x))(directions)
    elements = jax.jit(lambda: loaded_tangents(ball.body, loads, state))()
    unknowns = np.asarray(ball.body.element_unknowns)
    padded = np.vstack([np.asarray(directions), np.zeros((1, 2))])
    product = np.zeros_like(padded)
    np.add.at(product, unknowns, np.einsum("eij,ejc->eic", np.asarray(elements), padded[unknowns]))
    np.testing.assert_allclose(product[:-1], exact, rtol=0, atol=1e-11 * np.abs(exact).max())
    without = eqx.tree_at(lambda s: s.force, state, jnp.zeros(1))
    plain = jax.jit(lambda x: stiffness_map(ball.body, loads, without)(x))(directions)
    assert np.abs(np.asarray(exact - plain)).max() > 1e-3 * np.abs(exact).max()


@pytest.mark.slow
def test_the_pressure_of_sealed_gas_has_the_derivatives_of_its_law(sphere) -> None:
    """dp/dP₀ through the equilibrium, by jvp and vjp, against differences of full solves."""
    ball = sphere(1, 0.3)
    loads = Loads((_gas(ball, 0.5 * ball.rest_volume, 1.0),))
    newton = Newton(ball.newton.linear, step_tolerance=1e-13)

    def pressure(filling):
        start = State.rest(ball.body, loads)
        return solve(newton, ball.body, loads, filling[None], start).state.force[0]

    at = jnp.array(ATMOSPHERE + 3000.0)
    solved, slope = jax.jit(pressure), jax.jit(lambda p: jax.jvp(pressure, (p,), (jnp.ones(()),))[1])
    h = 30.0
    difference = (solved(at + h) - solved(at - h)) / (2 * h)
    np.testing.assert_allclose(slope(at), difference, rtol=1e-6)
    np.testing.assert_allclose(jax.jit(jax.grad(pressure))(at), slope(at), rtol=1e-10)
