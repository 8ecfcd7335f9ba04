"""Live steps of a slender body that turns far from frame to frame.

A beam of twenty times its height, bent by a force at its end until that has moved by half the length; what is
read is where the end is.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.estimation.estimator import Estimator, StepSettings
from softfuse.estimation.limits import Limits
from softfuse.estimation.step import Observation, exact_steps
from softfuse.functional.marker import Marker
from softfuse.material import NeoHookean
from softfuse.mechanics import LinearPorts, PrescribedForce
from softfuse.mechanics.model import Model, simulate
from softfuse.mechanics.reading import ShapeReading
from softfuse.mechanics.sparse import SparseLU
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.tetmesh import tet_mesh

LENGTH, HEIGHT, YOUNG = 0.1, 0.005, 2e5
NOWHERE = jnp.zeros((0, 3, 3))
LARGEST_N = 3.0 * YOUNG * HEIGHT**4 / 12 / LENGTH**2
"""F L²/(E I) = 3: an elastica's end has moved by 0.6 of the length."""


@pytest.fixture(scope="module")
def beam() -> Model:
    cells = 2 * round(LENGTH / HEIGHT)
    across = np.linspace(0.0, HEIGHT, 2)
    grid = kuhn_grid(
        (np.linspace(0, LENGTH, cells + 1), across, across), np.ones((cells, 1, 1), bool), (0, 0, 0)
    )
    mesh = mesh_for(QUADRATIC, oriented(tet_mesh(grid.nodes, grid.tets)))
    law = NeoHookean.from_young(YOUNG, 0.3)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 0] == 0.0, element=QUADRATIC)
    end = Marker.of(body, np.array([LENGTH, HEIGHT / 2, HEIGHT]))
    ends = np.flatnonzero(mesh.nodes[:, 0] == LENGTH)
    down = body.spread(jnp.asarray(ends), jnp.tile(jnp.array([[0.0], [0.0], [-1.0]]), (len(ends), 1, 1)))
    ports = LinearPorts(jnp.zeros(1), down / len(ends))
    force = PrescribedForce.on(ports, body, jnp.ones(1))
    return Model(body, (ShapeReading(end),), (), SparseLU.plan(body), (force,))


@pytest.fixture(scope="module")
def bent(beam: Model) -> list[tuple[float, Observation]]:
    """Forces [N] and what is read of their equilibria, a tenth of the length apart at most."""
    at = eqx.filter_jit(lambda force: beam.reading(simulate(beam, NOWHERE, force[None]).state))
    forces = np.linspace(0.0, LARGEST_N, 9)[1:]
    return [(f, Observation(at(jnp.asarray(f)), 1e5 * jnp.eye(3), NOWHERE)) for f in forces]


@pytest.fixture(scope="module")
def limits() -> Limits:
    return Limits(jnp.zeros(1), jnp.array([10 * LARGEST_N]), jnp.zeros(1))


@pytest.mark.parametrize(("steps", "off"), ((1, 0.05), (2, 5e-4)))
def test_the_end_of_a_beam_may_go_far_in_a_frame(beam: Model, bent, limits, steps: int, off: float) -> None:
    """With the stresses of the state that the step before made the force would be up to 22 times as large."""
    estimator = Estimator(beam, limits, NOWHERE, StepSettings(steps_per_frame=steps))
    found = [estimator.update(seen) for _, seen in bent]
    assert not any(each.lost for each in found)
    np.testing.assert_allclose([each.drive[0] for each in found], [force for force, _ in bent], rtol=off)


def test_exact_steps_from_rest_find_a_beam_that_is_bent_far(beam: Model, bent, limits) -> None:
    """In steps of a fifth of its length; and what they find has the slope of finite differences."""
    force, seen = bent[-1]
    limits = limits._replace(motion=jnp.asarray(LENGTH / 5))

    @eqx.filter_jit
    def found(along):
        moved = seen._replace(reading=seen.reading + along * bent[-2][1].reading)
        return exact_steps(beam, limits, beam.rest_state(NOWHERE), moved, steps=8)[0].drive[0]

    np.testing.assert_allclose(found(0.0), force, rtol=1e-6)
    h = 1e-5
    slope = eqx.filter_jit(jax.jacfwd(found))(0.0)
    np.testing.assert_allclose(slope, (found(h) - found(-h)) / (2 * h), rtol=1e-6)
