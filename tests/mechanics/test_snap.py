"""A snap is told, and where: a dome on a square, clamped along its edge and pressed on its crown.

Up to its limit load it follows every small increment; there its stiffness along the path vanishes, and it
jumps through. The limit load is found here by increments of the test's own.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.material import NeoHookean
from softfuse.mechanics import RESULTS, LinearPorts, Loads, Newton, PrescribedForce, Solution, State, solve
from softfuse.mechanics.sparse import SparseLU

pytestmark = pytest.mark.slow

HALF, THICKNESS, RISE, YOUNG = 10e-3, 1e-3, 4.5e-3, 1e6


@pytest.fixture(scope="module")
def dome(box) -> Callable[..., Solution]:
    """dome(force, start): pressed with a force in N on its crown, from rest or a state."""
    edges = np.linspace(-HALF, HALF, 9)
    flat = box(edges, edges, [0.0, THICKNESS])
    nodes = np.array(flat.nodes)
    nodes[:, 2] += RISE * np.prod(1 - (nodes[:, :2] / HALF) ** 2, axis=1)
    mesh = mesh_for(QUADRATIC, replace(flat, nodes=nodes))
    from_middle = np.abs(mesh.nodes[:, :2]).max(axis=1)
    body = Body.from_mesh(
        mesh, [NeoHookean.from_young(YOUNG, 0.0)], from_middle > HALF - 1e-9, element=QUADRATIC
    )
    crown = np.flatnonzero((from_middle < 1e-9) & (mesh.nodes[:, 2] > RISE + THICKNESS - 1e-9))
    rows = np.zeros((body.n, 1))
    rows[np.asarray(body.displacement_index)[crown, 2], 0] = -1 / len(crown)
    loads = Loads((PrescribedForce.on(LinearPorts(jnp.zeros(1), jnp.asarray(rows)), body, jnp.ones(1)),))
    newton, solved = Newton(SparseLU.plan(body)), eqx.filter_jit(solve)

    def press(force: float, start: State | None = None) -> Solution:
        start = State.rest(body, loads) if start is None else start
        return solved(newton, body, loads, jnp.array([force]), start)

    return press


@pytest.fixture(scope="module")
def limit(dome) -> float:
    """The largest load [N] that small increments reach."""
    state, load, increment = None, 0.0, 0.02
    while increment > 1e-3:
        found = dome(load + increment, state)
        if found.result == RESULTS.converged:
            state, load = found.state, load + increment
        else:
            increment /= 2
        assert load < 1.0
    return load


@pytest.mark.parametrize("beyond", (1.02, 1.05, 1.2))
def test_a_load_beyond_the_limit_ends_before_the_snap(dome, limit: float, beyond: float) -> None:
    found = dome(beyond * limit)
    assert found.result == RESULTS.snapped
    reached = float(found.state.drive[0])
    assert limit - 2 * beyond * limit / 256 < reached < 1.01 * limit
    # The crown has gone down by less than the dome's rise and a half; beyond the snap it hangs through.
    assert float(jnp.max(jnp.abs(found.state.z))) < 1.5 * RISE


def test_below_the_limit_nothing_is_told(dome, limit: float) -> None:
    found = dome(0.95 * limit)
    assert found.result == RESULTS.converged and float(found.state.drive[0]) == 0.95 * limit
