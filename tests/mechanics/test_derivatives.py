"""Implicit derivatives of the equilibrium, one test a transform, against differences of full solves.

Readings (marker [m], volume inside the skin [m³], depth of the disc [m]) as functions of everything an
equilibrium depends on: force, material constants, rest nodes, location, radius and layer of the disc.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import Contact
from softfuse.functional.marker import Marker
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mechanics import RESULTS, Loads, Newton, Punch, State, solve
from softfuse.mechanics.dense import Dense

PARTS = ("force", "law", "rest", "location", "radius", "compliance")


class Cause(NamedTuple):
    """All that the readings are differentiated in."""

    force: jax.Array
    law: NeoHookean
    rest: jax.Array
    location: jax.Array
    radius: jax.Array
    compliance: jax.Array


class Effect(NamedTuple):
    """What is read, and how the search for it ended."""

    readings: jax.Array
    state: State
    result: RESULTS


class Model:
    """A pad under a rigid disc, the cause at which it is differentiated, and a direction to change it in.

    The three programs are compiled once for all tests.
    """

    def __init__(self, body, skin, top) -> None:
        newton = Newton(Dense.plan(body), step_tolerance=1e-12)
        cells = flat_punch((0.6, 1.0), (1, 4))
        volume = Cavity(jnp.asarray(skin))
        camera = np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]])
        marker = Marker.of(body, np.array([0.011, 0.008, 0.009]), rotation=camera, components=(0,))
        self.traces = 0

        def read(cause: Cause, start: State) -> Effect:
            self.traces += 1
            changed = body.with_rest(cause.rest).with_materials([cause.law])
            disc = Contact(top, cells, cause.location, cause.radius, cause.compliance)
            loads = Loads((Punch.of(disc, changed),))
            solution = solve(newton, changed, loads, cause.force, start)
            x = changed.rest + changed.displacement(solution.state.z)
            seen = marker.value(changed, solution.state.z)[0]
            readings = jnp.stack([seen, volume(x), solution.state.internal[0]])
            return Effect(readings, solution.state, solution.result)

        def forward(cause, start, direction):
            def readings(c):
                effect = read(c, start)
                return effect.readings, effect

            _, slope, effect = jax.jvp(readings, (cause,), (direction,), has_aux=True)
            return slope, effect

        def backward(cause, start_z, start, weights):
            def readings(c, z):
                return read(c, eqx.tree_at(lambda s: s.z, start, z)).readings

            return jax.vjp(readings, cause, start_z)[1](weights)

        self.read = read
        self.forward = jax.jit(forward)
        self.backward = jax.jit(backward)
        self.rest = State(jnp.zeros(body.n), jnp.zeros(cells.count), jnp.zeros(1), jnp.zeros(1))
        random = np.random.default_rng(0)
        # Depth counts from where the disc first touches: on a perfectly flat top everywhere at once, which
        # has no derivative. This one is uneven by some hundredths of a millimetre.
        uneven = 2e-5 * jnp.asarray(random.normal(size=body.rest.shape))
        self.at = Cause(
            jnp.array([3.0]),
            body.materials[0],
            body.rest + uneven,
            jnp.array([0.0094, 0.0104, 0.01]),
            jnp.asarray(0.0062),
            jnp.asarray(0.002 * 0.0062 / float(body.pressure_unit)),
        )
        # Each part changes by its own size, or the nodes and the disc by a fraction of an element.
        self.along = Cause(
            0.7 * self.at.force,
            jax.tree.map(lambda c: random.uniform(0.5, 1.0) * c, self.at.law),
            0.002 * jnp.asarray(random.normal(size=body.rest.shape)),
            0.002 * jnp.asarray(random.normal(size=3)),
            0.5 * self.at.radius,
            1000.0 * self.at.compliance,
        )

    def only(self, *parts: str) -> Cause:
        """The direction that changes these parts alone."""
        return Cause(
            *(
                part if name in parts else jax.tree.map(jnp.zeros_like, part)
                for name, part in self.along._asdict().items()
            )
        )

    def solved(self, cause: Cause) -> np.ndarray:
        """Readings of a full solve from rest, which must press the same cells as everywhere here."""
        _, effect = self.forward(cause, self.rest, self.only())
        assert effect.result == RESULTS.converged
        np.testing.assert_array_equal(effect.state.force > 0, self.pressed)
        return np.asarray(effect.readings)

    @property
    def pressed(self) -> np.ndarray:
        """The cells that carry force at the cause: some of them."""
        pressed = np.asarray(self.forward(self.at, self.rest, self.only())[1].state.force) > 0
        assert 1 < pressed.sum() < pressed.size
        return pressed


@pytest.fixture(scope="module")
def model(pad, top) -> Model:
    return Model(*pad(), top)


def _dot(a, b) -> float:
    return float(jnp.vdot(ravel_pytree(a)[0], ravel_pytree(b)[0]))


def _difference(function, at, direction, h: float) -> np.ndarray:
    """Central differences, once extrapolated: the error is O(h⁴)."""

    def central(step):
        ahead, behind = (
            np.asarray(function(jax.tree.map(lambda v, d, s=s: v + s * d, at, direction)))
            for s in (step, -step)
        )
        return (ahead - behind) / (2 * step)

    return (4 * central(h / 2) - central(h)) / 3


@pytest.mark.parametrize("part", PARTS)
def test_jvp_is_the_difference_of_full_solves(part, model) -> None:
    direction = model.only(part)
    slope, _ = model.forward(model.at, model.rest, direction)
    np.testing.assert_allclose(slope, _difference(model.solved, model.at, direction, 1e-4), rtol=1e-6)
    # The part matters: none of the readings' derivatives is 0 by itself.
    assert np.all(np.abs(slope) > [1e-5, 1e-11, 1e-5])


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_vjp_is_the_transpose_of_jvp(part, model) -> None:
    direction = model.only(part)
    slope, _ = model.forward(model.at, model.rest, direction)
    for weights in np.eye(3):
        pulled, _ = model.backward(model.at, model.rest.z, model.rest, weights)
        np.testing.assert_allclose(_dot(pulled, direction), slope @ weights, rtol=1e-10)


def test_jit_traces_each_program_once(model) -> None:
    """New loads, constants, nodes and locations need no new program."""
    weights = np.ones(3)
    model.forward(model.at, model.rest, model.along)
    model.backward(model.at, model.rest.z, model.rest, weights)
    before = model.traces
    other = jax.tree.map(lambda v, d: v + 0.01 * d, model.at, model.along)
    model.forward(other, model.rest, model.only("law"))
    model.backward(other, model.rest.z, model.rest, 2 * weights)
    assert model.traces == before


@pytest.mark.slow
def test_vmap_over_loads_is_each_alone(model) -> None:
    """One of the loads is too large: its lane says so, and the others do not mind."""
    forces = jnp.array([[0.5], [3.0], [3.3], [1e4]])
    many = jax.jit(jax.vmap(lambda f: model.read(model.at._replace(force=f), model.rest)))(forces)
    np.testing.assert_array_equal(many.result == RESULTS.converged, [True, True, True, False])
    assert np.all(np.isfinite(many.readings))
    for k in range(4):
        _, alone = model.forward(model.at._replace(force=forces[k]), model.rest, model.only())
        np.testing.assert_allclose(many.readings[k], alone.readings, rtol=1e-9)
        assert np.asarray(many.result == alone.result)[k]


def test_derivatives_do_not_depend_on_the_start(model) -> None:
    """From near the solution they are those from rest, and none flows into the start."""
    near = model.forward(model.at._replace(force=0.9 * model.at.force), model.rest, model.only())[1].state
    slope, effect = model.forward(model.at, model.rest, model.along)
    again, effect_again = model.forward(model.at, near, model.along)
    np.testing.assert_allclose(effect_again.readings, effect.readings, rtol=1e-9)
    np.testing.assert_allclose(again, slope, rtol=1e-8)
    _, by_start = model.backward(model.at, near.z, near, np.ones(3))
    np.testing.assert_array_equal(by_start, 0.0)


@pytest.mark.slow
def test_second_derivative_in_the_force_is_the_difference_of_first_ones(model) -> None:
    """Forward over reverse: how the disc's compliance changes with its load."""

    def depth(force):
        return model.read(model.at._replace(force=force), model.rest).readings[2]

    ones = jnp.ones(1)
    second = jax.jit(lambda f: jax.jvp(jax.grad(depth), (f,), (ones,)))
    first, curvature = second(model.at.force)

    def slope(force):
        unit = model.only()._replace(force=ones)
        return model.forward(model.at._replace(force=force), model.rest, unit)[0][2]

    np.testing.assert_allclose(first[0], slope(model.at.force), rtol=1e-10)
    difference = _difference(slope, model.at.force, ones, 1e-3)
    np.testing.assert_allclose(curvature[0], difference, rtol=1e-6)
    assert abs(float(curvature[0] * model.at.force[0] / first[0])) > 0.01
