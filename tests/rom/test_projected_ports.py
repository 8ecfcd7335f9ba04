"""What presses on a finger and what is attached to it does to modes what it does to the full body."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.mechanics.linearised import loaded_tangents
from softfuse.mechanics.load import AbstractPorts
from softfuse.mechanics.model import Model
from softfuse.mechanics.prescribed import PrescribedForce
from softfuse.mechanics.solution import State
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot
from softfuse.rom.basis import Basis, rest_stiffness
from softfuse.rom.projected_ports import projected_load
from softfuse.rom.reduced_model import reduced_model
from softfuse.rom.sampling import Cubature, Sampling
from softfuse.rom.teaching import Chart

pytestmark = pytest.mark.slow

MODES = 8
PRESSED = [4, 10]
"""Electrodes that two contacts press at."""


class Pair(NamedTuple):
    """A finger, the same on a few smooth modes (n, m), the chart of these, and where two contacts press."""

    full: Model
    small: Model
    modes: np.ndarray
    chart: Chart
    places: jax.Array


@pytest.fixture(scope="module")
def pair(linear_finger: Callable[..., Path]) -> Pair:
    robot = build_robot(load(linear_finger()))
    full, electrodes = robot.model, np.array(list(robot.settings.places.values()))
    body = full.body
    assert isinstance(body, Body)
    random = np.random.default_rng(3)
    x = np.asarray(body.rest) / 0.12
    powers = np.stack([x[:, 0] * x[:, k] ** p for k in range(3) for p in (0, 1, 2)], axis=1)
    fields = powers @ random.normal(size=(powers.shape[1], 3 * MODES))
    nodal = 2e-3 * fields.reshape(len(x), 3, MODES)
    index = np.asarray(body.displacement_index)
    modes = np.zeros((body.n, MODES))
    free = index < body.n_displacements
    modes[index[free]] = nodal[free]
    basis = Basis(modes[: body.n_displacements], np.zeros((body.n - body.n_displacements, 0)))
    count = body.volumes.size
    every = Sampling(Cubature(np.arange(count), np.ones(count), 0.0), True)
    chart = Chart(basis, every, np.array([0]), np.ones(MODES), np.zeros((1, MODES)), 1e-3)
    small = reduced_model(full, rest_stiffness(body), chart, electrodes)
    return Pair(full, small, basis.columns, chart, jnp.asarray(electrodes[PRESSED]))


def states(pair: Pair) -> tuple[State, State]:
    """The same state of both, some forces and pressures acting."""
    random = np.random.default_rng(5)
    amplitudes = random.normal(size=MODES)
    rest = pair.full.rest_state(pair.places)
    force = jnp.asarray(random.normal(size=rest.force.shape))
    return tuple(
        State(jnp.asarray(z), force, rest.internal, rest.drive) for z in (pair.modes @ amplitudes, amplitudes)
    )


def test_ports_have_the_same_values_and_the_projected_rows(pair) -> None:
    exact, found = states(pair)
    for model, state, modes in ((pair.full, exact, pair.modes), (pair.small, found, np.eye(MODES))):
        loads = model.loads(pair.places)
        values = np.asarray(jax.jit(lambda d, z, loads=loads: loads.values(d.body, z))(model, state.z))
        rows = modes.T @ np.asarray(jax.jit(lambda d, z, loads=loads: loads.rows(d.body, z))(model, state.z))
        if model is pair.full:
            expected = values, rows, np.asarray(loads.supports)
    np.testing.assert_allclose(values, expected[0], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(
        rows, expected[1], rtol=1e-7, atol=1e-9 * np.abs(expected[1]).max(axis=0).min()
    )
    np.testing.assert_allclose(loads.supports, expected[2])


def test_pressures_and_springs_stiffen_modes_as_they_stiffen_nodes(pair) -> None:
    exact, found = states(pair)
    added = []
    for model, state in ((pair.full, exact), (pair.small, found)):
        loads, body = model.loads(pair.places), model.body
        pushed = State(state.z, 1e5 * state.force, state.internal, state.drive)
        tangents = [
            np.asarray(jax.jit(lambda b, s, loads=loads: loaded_tangents(b, loads, s))(body, pushed)),
            np.asarray(jax.jit(lambda b, z: b.element_tangents(z))(body, state.z)),
        ]
        added.append((tangents[0] - tangents[1], np.asarray(body.element_unknowns)))
    (by_element, unknowns), (small, _) = added
    modes = np.append(pair.modes, np.zeros((1, MODES)), axis=0)[np.minimum(unknowns, len(pair.modes))]
    expected = np.einsum("edm,edf,efk->mk", modes, by_element, modes)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(small[0], expected, atol=1e-8 * np.abs(expected).max())


def test_arms_are_those_of_the_patches(pair) -> None:
    for small, full in zip(pair.small.contacts, pair.full.contacts, strict=True):
        np.testing.assert_array_equal(small.arms, full.arms)
        assert small.drives == full.drives


class Unheard(AbstractPorts):
    """Ports that nobody has said how to project."""

    def values(self, body, z):
        return z

    def rows(self, body, z):
        return jnp.eye(len(z))

    def stiffen(self, body, z, force, tangents):
        return tangents

    @property
    def supports(self):
        return jnp.zeros(1)

    def resultants(self, body, z):
        return jnp.zeros((6, len(z)))


def test_what_has_no_projection_is_refused(pair) -> None:
    load = PrescribedForce(Unheard(), jnp.zeros(1), jnp.ones(1))
    with pytest.raises(SolveError, match="Unheard attached cannot be reduced"):
        projected_load(load, pair.full.body, pair.small.body, pair.chart)
