"""Gradients of tip, pressures and estimated force in guides, material and cable, against finite differences.

A block with two sealed cavities is clamped at one end; a cable runs along below them, something presses on
one side. Both ways round: loads to tip and pressures, and readings to force.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.estimation.limits import Limits
from softfuse.estimation.nonlinear import nonlinear_estimate
from softfuse.estimation.step import Observation
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.marker import Marker
from softfuse.functional.pressure_cells import uniform
from softfuse.functional.skin import Skin
from softfuse.material import NeoHookean
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.indenters import SurfacePatches
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.reading import AnswerReading, ShapeReading
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface

GEOMETRY = PadGeometry((0.07, 0.04, 0.018), (0.026, 0.028, 0.006), ((-0.017, 0.0), (0.017, 0.0)), 0.006)
GUIDES = np.array([[x, 0.001, 0.003] for x in (-0.02, 0.0, 0.02, 0.03)])
PULLED_AT = np.array([-0.04, 0.0, 0.002])
SEALED = 101325.0
FORCE, SHORTENED = 1.5, 2e-3
PLACE = jnp.asarray(facing(np.array([[0.02, 0.02, 0.009]]), (0, -1, 0)))


class Given(NamedTuple):
    """What gradients are taken in: guides (g, 3) m, factor on the modulus, shortening or its reading [m]."""

    guides: jnp.ndarray
    modulus: jnp.ndarray
    shortened: jnp.ndarray


AT = Given(jnp.asarray(GUIDES), jnp.ones(()), jnp.asarray(SHORTENED))


@pytest.fixture(scope="module")
def pulled() -> Model:
    """The robot as it is estimated: the tension is unknown, the cable's length a reading."""
    mesh = mesh_for(LINEAR, pad_mesh(GEOMETRY, 0.04, 0.04))
    x = mesh.nodes[:, 0]
    body = Body.from_mesh(mesh, [NeoHookean.from_young(0.6e6, 0.3)], x < x.min() + 1e-9, element=LINEAR)
    walls = tuple(Cavity(jnp.asarray(s.faces)) for s in cavities(mesh, GEOMETRY.centres()))
    gas = SealedGas.of(walls, body, jnp.full(2, 1e-6))
    cable = PulledCable.through(body, GUIDES, PULLED_AT)
    skin = Skin.of(outer_surface(mesh).faces, mesh.nodes, 7.5e-3)
    contact = SurfacePatches(skin, uniform(rings=3, angles=8), 5e-3)
    tip = int(np.argmax(mesh.nodes @ [1.0, 0.1, 0.1]))
    markers = (Marker(jnp.array([tip]), jnp.ones(1), axis) for axis in jnp.eye(3))
    readings = (*map(ShapeReading, markers), AnswerReading((0, 1, 2)))
    return Model(body, readings, (contact,), Dense.plan(body), (cable, gas))


def _with(model: Model, given: Given) -> Model:
    """The robot with other guides and another modulus."""
    law = model.body.materials[0]
    scaled = jax.tree.map(lambda constant: constant * given.modulus, law)
    return eqx.tree_at(
        lambda d: (d.actuators[0].ports.points.location, d.body.materials[0]), model, (given.guides, scaled)
    )


def _directions() -> list[Given]:
    still = jax.tree.map(jnp.zeros_like, AT)
    random = jnp.asarray(np.random.default_rng(3).normal(size=GUIDES.shape))
    return [
        still._replace(guides=1e-3 * random),
        still._replace(modulus=jnp.ones(())),
        still._replace(shortened=jnp.array(1e-3)),
    ]


def _agree(function: Callable[[Given], jnp.ndarray], tolerance: float) -> None:
    """Directional derivatives of a function are those of central differences."""
    compiled = jax.jit(function)
    slope = jax.jit(lambda direction: jax.jvp(function, (AT,), (direction,))[1])
    step = 1e-3
    for direction in _directions():
        ends = [
            compiled(jax.tree.map(lambda a, d, s=sign: a + s * step * d, AT, direction)) for sign in (1, -1)
        ]
        expected = np.asarray((ends[0] - ends[1]) / (2 * step))
        assert np.abs(expected).max() > 1e-3
        size = 0.1 * np.abs(expected).max()
        np.testing.assert_allclose(slope(direction), expected, rtol=tolerance, atol=tolerance * size)


@pytest.mark.slow
def test_tip_and_pressures(pulled: Model) -> None:
    def measured(given: Given) -> jnp.ndarray:
        model = _with(pulled, given)
        cable = model.actuators[0]
        assert isinstance(cable, PulledCable)
        held = ShortenedCable.of(cable, model.body)
        model = eqx.tree_at(lambda d: d.actuators, model, (held, model.actuators[1]))
        drive = jnp.concatenate([jnp.array([FORCE]), given.shortened[None], jnp.full(2, SEALED)])
        reading = model.reading(simulate(model, PLACE, drive).state)
        return jnp.concatenate([reading[:3] / 1e-3, reading[4:] / 1e3])

    _agree(measured, 1e-5)


@pytest.mark.slow
def test_estimated_force(pulled: Model) -> None:
    sealed = jnp.full(2, SEALED)
    limits = Limits(
        jnp.concatenate([jnp.zeros(2), sealed]), jnp.concatenate([jnp.full(2, 20.0), sealed]), jnp.zeros(4)
    )
    true = jnp.concatenate([jnp.array([FORCE, 3.0]), sealed])
    start = simulate(pulled, PLACE, true).state
    reading = pulled.reading(start)
    weight = jnp.array([0.0, 0.0, 0.0, 1 / 5e-5, 0.2, 0.2])

    def estimated(given: Given) -> jnp.ndarray:
        seen = Observation(reading.at[3].add(given.shortened - SHORTENED), jnp.diag(weight), PLACE)
        return nonlinear_estimate(_with(pulled, given), limits, start, seen).drive[:2]

    np.testing.assert_allclose(jax.jit(estimated)(AT), [FORCE, 3.0], rtol=1e-6)
    _agree(estimated, 1e-4)
