"""A thick sphere, held outside and inflated inside, against Lamé's solution.

u(r) = A r + C / r² with u(b) = 0 and σ_r(a) = −p: A = −p / (3λ + 2μ + 4μ b³/a³), C = −A b³ (Timoshenko and
Goodier, Theory of Elasticity, 1970, § 136), for a pressure that strains little. The pressure is the dead load
p ∂V/∂u of the cavity; compared is ΔV/V = 3 u(a)/a.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import TAYLOR_HOOD, Body
from softfuse.equilibrium import RESULTS, Loads, Newton, PrescribedForce, State, solve
from softfuse.equilibrium.sparse import SparseLU
from softfuse.equilibrium.volume import VolumePorts
from softfuse.functional import Cavity
from softfuse.material import NeoHookean
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.surface import cavities
from softfuse.mesh.tetmesh import quadratic, tet_mesh

INNER, OUTER, YOUNG = 5e-3, 10e-3, 1e5


def _swelling(layers: int, poisson: float, pressure: float) -> float:
    """ΔV / V of the cavity, on so many layers of boxes between the spheres."""
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

    air = VolumePorts.of((cavity,), body)
    loads = Loads((PrescribedForce(air, jnp.full(1, pressure)),))
    start = State.rest(body, loads)
    solution = solve(Newton(SparseLU.plan(body)), body, loads, jnp.array([pressure]), start)
    assert solution.result == RESULTS.converged
    rest, swollen = (float(air.values(body, state.z)[0]) for state in (start, solution.state))
    return swollen / rest - 1


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_a_sphere_swells_as_lame_says(poisson: float) -> None:
    pressure = 1.0  # Pa, 1e-5 of E: strains whose squares do not matter
    mu, lame = YOUNG / 2 / (1 + poisson), YOUNG * poisson / (1 + poisson) / (1 - 2 * poisson)
    ratio = (OUTER / INNER) ** 3
    exact = 3 * pressure * (ratio - 1) / (3 * lame + 2 * mu + 4 * mu * ratio)
    coarse, fine = (_swelling(layers, poisson, pressure) / exact - 1 for layers in (1, 2))
    assert abs(fine) < 0.03
    assert abs(fine) < 0.5 * abs(coarse)
