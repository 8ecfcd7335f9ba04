"""Equilibria: the elastica, balance, independence of the path, and failure as data.

Elastica: θ'' = −α cos θ on [0, 1], θ(0) = 0, θ'(1) = 0, α = P L²/(E I), x' = cos θ, y' = sin θ, lengths in
units of L (tabulated by Mattiasson, Int. J. Numer. Methods Eng. 17, 1981). A beam of height h differs from it
by its shear, 3 E I/(κ G A L²) = 0.6 (h/L)² of the deflection at ν = 0 for small loads (Timoshenko, κ = 5/6, G
= E/2): the error must fall with the square of the slenderness.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_bvp

from softfuse.body import QUADRATIC, TAYLOR_HOOD, Body, mesh_for
from softfuse.functional.contact import Contact
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean, SaintVenantKirchhoff
from softfuse.mechanics import (
    RESULTS,
    LinearPorts,
    Loads,
    Multifrontal,
    Newton,
    PrescribedForce,
    Punch,
    Solution,
    State,
    solve,
)
from softfuse.mechanics.sparse import SparseLU
from softfuse.mechanics.surface_ports import CellPorts
from softfuse.mesh.surface import boundary_faces

LOAD, YOUNG, HEIGHT = 3.0, 1e6, 1e-3
_solve = eqx.filter_jit(solve)
_residual, _volume_ratios = jax.jit(Body.residual), jax.jit(Body.volume_ratios)


def _left(body: Body, rows, state: State) -> np.ndarray:
    """What the cells' forces do not balance (n,), by the test's own sum."""
    return np.asarray(_residual(body, state.z) - rows @ state.force)


def elastica(load: float) -> tuple[float, float]:
    """Tip (x, y) in units of the length."""

    def slopes(_, y):
        return np.array([y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, 1.0, 41)
    found = solve_bvp(slopes, ends, s, np.array([s, 1 - s, s, 0.5 * s]), tol=1e-8)
    assert found.success
    return float(found.y[2, -1]), float(found.y[3, -1])


def test_elastica_is_the_tabulated_one_and_for_small_loads_the_linear_beam() -> None:
    np.testing.assert_allclose(elastica(LOAD), (1 - 0.25442, 0.60325), rtol=0, atol=6e-6)
    np.testing.assert_allclose(elastica(1e-3), (1.0, 1e-3 / 3), rtol=1e-6)


class Tip(NamedTuple):
    x: float
    y: float
    solution: Solution
    unbalanced: float


@pytest.fixture(scope="module")
def cantilever(box):
    """cantilever(element, law, slenderness, boxes): the loaded beam's tip in units of its length."""

    def bend(element, law, slenderness: int, boxes: int) -> Tip:
        length, side = slenderness * HEIGHT, [0.0, HEIGHT]
        mesh = mesh_for(element, box(np.linspace(0.0, length, boxes + 1), side, side))
        body = Body.from_mesh(mesh, [law], mesh.nodes[:, 0] == 0.0, element=element)
        faces = boundary_faces(mesh).faces
        end = faces[np.all(np.isclose(mesh.nodes[faces[:, :3], 0], length), axis=1)]
        assert len(end) == 2
        # A uniform dead load on two equal quadratic faces acts on the middles of their edges, a sixth each.
        rows = np.zeros((body.n, 1))
        np.add.at(rows[:, 0], np.asarray(body.displacement_index)[end[:, 3:], 2], 1 / 6)
        force = LOAD * YOUNG * HEIGHT**4 / 12 / length**2
        newton = Newton(SparseLU.plan(body))
        end_force = PrescribedForce.on(LinearPorts(jnp.zeros(1), jnp.asarray(rows)), body, jnp.ones(1))
        loads = Loads((end_force,))
        solution = _solve(newton, body, loads, jnp.array([force]), State.rest(body, loads))
        displacement = np.asarray(body.displacement(solution.state.z))
        at_end = displacement[np.unique(end[:, 3:])].mean(axis=0) / length
        left = np.abs(_left(body, rows, solution.state)).max() / force
        return Tip(1 + at_end[0], float(rows[:, 0] @ solution.state.z) / length, solution, left)

    return bend


def test_cantilever_approaches_the_elastica_with_its_slenderness(cantilever) -> None:
    x, y = elastica(LOAD)
    law = SaintVenantKirchhoff.from_young(YOUNG, 0.0)
    tips = [cantilever(QUADRATIC, law, slenderness, 20) for slenderness in (10, 20)]
    for tip in tips:
        assert tip.solution.result == RESULTS.converged
        assert tip.unbalanced < 1e-9
    error_x, error_y = (np.array([tip[k] for tip in tips]) / exact - 1 for k, exact in ((0, x), (1, y)))
    assert np.abs(error_x[1]) < 2e-3 and np.abs(error_y[1]) < 3e-3
    for error in (error_x, error_y):
        assert 3.4 < error[0] / error[1] < 4.6
    assert error_y[1] > 0  # shear makes the beam softer


def test_taylor_hood_cantilever_follows_the_elastica(cantilever) -> None:
    """ν = 0.3: what differs is the root, held in all directions, and finite strain."""
    tip = cantilever(TAYLOR_HOOD, NeoHookean.from_young(YOUNG, 0.3), 20, 12)
    assert tip.solution.result == RESULTS.converged
    np.testing.assert_allclose((tip.x, tip.y), elastica(LOAD), rtol=1e-2)


@pytest.fixture(scope="module")
def pressed(pad, top):
    """The pad under a rigid disc: body, rows and solve(force, start)."""
    body, _ = pad()
    contact = Contact(
        top, flat_punch((0.6, 1.0), (1, 4)), jnp.array([0.0094, 0.0104, 0.01]), jnp.asarray(0.006)
    )
    loads = Loads((Punch.of(contact, body),))
    newton = Newton(Multifrontal.plan(body), step_tolerance=1e-11, max_load_steps=15)

    def at(force: float, start: State | None = None) -> Solution:
        start = State.rest(body, loads) if start is None else start
        return _solve(newton, body, loads, jnp.array([force]), start)

    return body, CellPorts.of(contact, body).slopes, at


@pytest.mark.parametrize("force", [0.1, 2.0, 10.0])
def test_a_converged_state_is_in_balance(pressed, force) -> None:
    body, rows, at = pressed
    solution = at(force)
    state = solution.state
    assert solution.result == RESULTS.converged
    assert np.abs(_left(body, rows, state)[: body.n_displacements]).max() < 1e-10 * force
    np.testing.assert_allclose(
        solution.stats.residual,
        np.abs(_left(body, rows, state)[: body.n_displacements]).max(),
        rtol=0,
        atol=1e-13,
    )
    # The pressures' equations are volume mismatches in units of the shear modulus.
    assert np.abs(_left(body, rows, state)[body.n_displacements :]).max() < 1e-12
    np.testing.assert_allclose(state.force.sum(), force + 1e-9, rtol=1e-11)  # a disc weighs a nanonewton
    np.testing.assert_array_equal(state.drive, force)
    assert np.min(_volume_ratios(body, state.z)) > 0
    under = np.asarray(rows.T @ state.z)
    on = np.asarray(state.force) > 0
    depth = float(state.internal[0])
    softened = under + 1e-10 * np.asarray(state.force) / (0.006 * float(body.pressure_unit))
    np.testing.assert_allclose(softened[on], depth, rtol=1e-11)
    assert np.all(np.asarray(state.force) >= 0) and np.all(softened >= depth * (1 - 1e-11))


@pytest.mark.slow
def test_the_path_does_not_matter(pressed) -> None:
    """From rest, from a smaller load, from a larger one and from another contact's set of cells."""
    body, _, at = pressed
    direct = at(4.0)
    smaller, larger = at(1.0).state, at(9.0).state
    lifted = eqx.tree_at(lambda s: s.force, smaller, jnp.where(smaller.force > 0, -1.0, 1.0))
    for start in (smaller, larger, lifted):
        found = at(4.0, start)
        assert found.result == RESULTS.converged
        assert int(found.stats.load_steps) == 1
        for name in ("z", "force", "internal"):
            expected = np.asarray(getattr(direct.state, name))
            np.testing.assert_allclose(
                getattr(found.state, name), expected, rtol=0, atol=1e-8 * np.abs(expected).max(), err_msg=name
            )
    again = at(4.0, direct.state)
    assert int(again.stats.newton_iterations) == 1


def test_no_load_no_motion(pressed) -> None:
    body, _, at = pressed
    solution = at(0.0)
    assert solution.result == RESULTS.converged
    np.testing.assert_allclose(solution.state.z[: body.n_displacements], 0.0, atol=1e-12)  # m
    np.testing.assert_allclose(solution.state.force, 0.0, atol=1e-8)


@pytest.mark.parametrize(
    "force, result", [(30.0, "step_limit"), (100.0, "step_limit"), (1e4, "inverted"), (1e7, "inverted")]
)
def test_far_too_large_a_load_is_a_result_and_leaves_the_last_equilibrium(pressed, force, result) -> None:
    """Too many increments, and steps that invert elements however short they are."""
    body, rows, at = pressed
    solution = at(force)
    assert solution.result == getattr(RESULTS, result)
    state = solution.state
    reached = float(state.drive[0])
    assert 0.0 <= reached < force
    assert np.all(np.isfinite(state.z))
    assert np.abs(_left(body, rows, state)).max() < 1e-10 * max(reached, 1.0)
    assert np.min(_volume_ratios(body, state.z)) > 0
    assert np.all(np.asarray(state.force) >= 0)
