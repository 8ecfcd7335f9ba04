"""Slender bodies that turn far in one increment, and weights that are continued.

A cantilever under its own weight q per length: θ'' = −α (1 − s) cos θ on [0, 1], θ(0) = 0, θ'(1) = 0, α = q
L³/(E I), lengths in units of L (Rohde, Q. Appl. Math. 11, 1953).
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_bvp

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.material import SaintVenantKirchhoff
from softfuse.mechanics import RESULTS, LinearPorts, Loads, Newton, PrescribedForce, Solution, State, solve
from softfuse.mechanics.sparse import SparseLU

YOUNG, HEIGHT, DENSITY = 1e6, 1e-3, 1e3
_solve = eqx.filter_jit(solve)


def heavy_elastica(load: float) -> tuple[float, float]:
    """Tip (x, y) in units of the length, y downwards."""

    def slopes(s, y):
        return np.array([y[1], -load * (1 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, 1.0, 101)
    guess = np.array([np.full_like(s, 1.2), 0 * s, 0.4 * s, 0.9 * s])
    found = solve_bvp(slopes, ends, s, guess, tol=1e-8, max_nodes=10000)
    assert found.success
    return float(found.y[2, -1]), float(found.y[3, -1])


@pytest.fixture(scope="module")
def hanging(box) -> Callable[..., tuple[Body, Callable[..., Solution]]]:
    """hanging(slenderness, load): a beam along x, its α, and the search from a state or rest."""

    def build(slenderness: int, load: float):
        length, side = slenderness * HEIGHT, [0.0, HEIGHT]
        gravity = load * YOUNG * HEIGHT**2 / 12 / (DENSITY * length**3)
        mesh = mesh_for(QUADRATIC, box(np.linspace(0.0, length, 2 * slenderness + 1), side, side))
        law = SaintVenantKirchhoff.from_young(YOUNG, 0.0)
        clamped = mesh.nodes[:, 0] == 0.0
        body = Body.from_mesh(
            mesh, [law], clamped, element=QUADRATIC, densities=[DENSITY], gravity=(0.0, 0.0, -gravity)
        )
        newton, nothing = Newton(SparseLU.plan(body), max_load_steps=8), jnp.zeros((body.n, 1))
        loads = Loads((PrescribedForce.on(LinearPorts(jnp.zeros(1), nothing), body, jnp.ones(1)),))

        def search(body: Body = body, start: State | None = None) -> Solution:
            start = State.rest(body, loads) if start is None else start
            return _solve(newton, body, loads, jnp.zeros(1), start)

        return body, search

    return build


def _tip(body: Body, state: State) -> np.ndarray:
    """(x, y) of the middle of the end in units of the length, y downwards."""
    rest = np.asarray(body.rest)
    end = rest[:, 0] == rest[:, 0].max()
    x = (rest + np.asarray(body.displacement(state.z)))[end].mean(axis=0)
    return np.array([x[0], 0.5 * HEIGHT - x[2]]) / rest[:, 0].max()


@pytest.mark.parametrize("slenderness", (10, 40))
def test_a_heavy_beam_sags_in_one_increment_however_slender(hanging, slenderness: int) -> None:
    body, search = hanging(slenderness, 8.0)
    found = search()
    assert found.result == RESULTS.converged
    assert int(found.stats.load_steps) == 1 and int(found.stats.newton_iterations) <= 16
    np.testing.assert_allclose(_tip(body, found.state), heavy_elastica(8.0), atol=0.3 / slenderness)


def test_the_way_goes_on_from_part_of_the_weight(hanging) -> None:
    """A state that carries half of the weight is no rest: the other half is continued from it."""
    body, search = hanging(10, 20.0)
    halved = eqx.tree_at(lambda b: b.weight, body, 0.5 * body.weight)
    half, whole = search(halved), search()
    again = search(body, half.state)
    assert again.result == RESULTS.converged
    assert int(again.stats.newton_iterations) < int(whole.stats.newton_iterations)
    np.testing.assert_allclose(again.state.z, whole.state.z, rtol=0, atol=1e-9)
    assert int(search(body, whole.state).stats.newton_iterations) == 1


def test_a_weight_that_cannot_be_carried_leaves_the_last_equilibrium(hanging) -> None:
    body, search = hanging(10, 1e7)
    found = search()
    share = float(found.stats.reached)
    assert not found.success and 0.0 <= share < 1.0
    left = body.residual(found.state.z) + (1.0 - share) * body.weight
    np.testing.assert_allclose(found.stats.residual, jnp.max(jnp.abs(left)), rtol=1e-6, atol=1e-15)
    assert float(jnp.max(jnp.abs(left))) < 1e-9 * float(jnp.sum(jnp.abs(body.weight)))
