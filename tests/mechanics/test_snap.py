"""Snaps are passed and told: a dome on a square, clamped along its edge and pressed on its crown.

Where the path of a given force ends, that of a given displacement of the crown goes on, through forces that
fall and rise again: its largest force is the limit load, and where the force is reached again the body hangs
through. That path is the reference.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.material import NeoHookean
from softfuse.mechanics import (
    RESULTS,
    LinearPorts,
    Loads,
    Newton,
    PrescribedDisplacement,
    PrescribedForce,
    Solution,
    State,
    solve,
)
from softfuse.mechanics.sparse import SparseLU

pytestmark = pytest.mark.slow

HALF, THICKNESS, RISE, YOUNG = 10e-3, 1e-3, 4.5e-3, 1e6


class Dome(NamedTuple):
    rows: np.ndarray
    press: Callable[..., Solution]
    push: Callable[..., Solution]


@pytest.fixture(scope="module")
def dome(box) -> Dome:
    """press(force, start): with a force in N on the crown, from rest or a state; push(depth, start): it moves
    down by so many m.
    """
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
    ports, newton = LinearPorts(jnp.zeros(1), jnp.asarray(rows)), Newton(SparseLU.plan(body))

    def by(kind) -> Callable[..., Solution]:
        loads, solved = Loads((kind.on(ports, body, jnp.ones(1)),)), eqx.filter_jit(solve)

        def at(drive: float, start: State | None = None) -> Solution:
            start = State.rest(body, loads) if start is None else start
            return solved(newton, body, loads, jnp.array([drive]), start)

        return at

    return Dome(rows, by(PrescribedForce), by(PrescribedDisplacement))


@pytest.fixture(scope="module")
def limit(dome: Dome) -> float:
    """The largest force [N] on the way down, by a parabola through the three largest."""
    state, forces = None, []
    depths = np.linspace(0.0, 1.6 * RISE, 49)[1:]
    for depth in depths:
        found = dome.push(depth, state)
        assert found.result == RESULTS.converged
        state = found.state
        forces.append(float(state.force[0]))
        if len(forces) > 1 and forces[-1] < forces[-2]:
            break
    k = int(np.argmax(forces))
    assert 0 < k < len(forces) - 1
    a, b, c = np.polyfit(depths[k - 1 : k + 2] - depths[k], forces[k - 1 : k + 2], 2)
    return c - b**2 / (4 * a)


@pytest.mark.parametrize("beyond", (1.005, 1.2))
def test_a_load_beyond_the_limit_is_found_after_the_snap(dome: Dome, limit: float, beyond: float) -> None:
    found = dome.press(beyond * limit)
    assert found.result == RESULTS.snapped and found.success and int(found.stats.snaps) == 1
    assert float(found.stats.reached) == 1.0
    assert float(dome.rows[:, 0] @ found.state.z) > 1.5 * RISE  # the crown hangs through
    again = dome.press(1.01 * beyond * limit, found.state)
    assert again.result == RESULTS.converged
    # The crown held where it came to lie takes the same force: the state is that of the other path.
    down = dome.rows[:, 0] @ found.state.z
    kept = dome.push(float(down), eqx.tree_at(lambda s: s.drive, found.state, down[None]))
    assert kept.result == RESULTS.converged
    np.testing.assert_allclose(kept.state.force, beyond * limit, rtol=1e-6)


def test_below_the_limit_nothing_is_told(dome: Dome, limit: float) -> None:
    found = dome.press(0.995 * limit)
    assert found.result == RESULTS.converged and float(found.state.drive[0]) == 0.995 * limit
    assert float(dome.rows[:, 0] @ found.state.z) < 1.2 * RISE
