"""What a robot reads has the derivatives in a layout's parameters that differences of re-solves have."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import Body
from softfuse.design.layout_model import model_at
from softfuse.errors import SoftfuseError
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.contact import ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.indenters import FlatIndenter
from softfuse.mechanics.model import Model
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.reading import AnswerReading, ShapeReading
from softfuse.mechanics.solution import RESULTS, State
from softfuse.mesh.block import Fineness, finer_to_the_top
from softfuse.mesh.surface import outer_surface
from softfuse.robot.layout.layout_mesh import layout_mesh

DISC = jnp.asarray(facing(np.array([[0.012, 0.003, 0.018]]), (0, 0, -1)))


@pytest.fixture(scope="module")
def mesh(twins):
    return layout_mesh(twins, twins.start, Fineness(0.04, finer_to_the_top(0.018, 0.04)))


@pytest.fixture(scope="module")
def sealed(twins, mesh) -> Model:
    """One cavity vented, one sealed, a disc of 8 mm."""
    made = mesh.mesh(twins.start)
    body = Body.from_mesh(made, [NeoHookean.from_young(0.6e6, 0.49)], made.nodes[:, 2] < 1e-9)
    surface = ContactSurface.facing(outer_surface(made).faces, made.nodes, np.array([0.0, 0.0, -1.0]))
    contact = FlatIndenter(surface, flat_punch((0.7, 1.0), (3, 6)), 0.008)
    vented, closed = (Cavity(jnp.asarray(wall.faces)) for wall in mesh.walls)
    gas = SealedGas.of((closed,), body, jnp.array([1e-6]))
    readings = ShapeReading(vented), AnswerReading((0,))
    return Model(body, readings, (contact,), Multifrontal.plan(body), (gas,))


@pytest.mark.slow
def test_readings_have_the_derivatives_of_re_solves(twins, mesh, sealed) -> None:
    @jax.jit
    def pressed(theta):
        model = model_at(sealed, mesh, theta)
        loads = model.loads(DISC)
        newton = Newton(model.linear, step_tolerance=1e-12)
        drive = jnp.array([4.0, 101325.0])
        solution = solve(newton, model.body, loads, drive, State.rest(model.body, loads))
        return model.reading(solution.state), solution.result

    at = jnp.asarray(twins.start)
    reading, result = pressed(at)
    assert result == RESULTS.converged
    slope = jax.jit(jax.jacfwd(lambda theta: pressed(theta)[0]))(at)
    for k, step in enumerate(0.02 * twins.scale):

        def central(h, k=k):
            return (pressed(at.at[k].add(h))[0] - pressed(at.at[k].add(-h))[0]) / (2 * h)

        difference = (4 * central(step / 2) - central(step)) / 3
        assert np.all(np.abs(difference) * twins.scale[k] > 1e-6 * np.abs(reading))
        np.testing.assert_allclose(slope[:, k], difference, rtol=1e-6)


def test_gas_is_sealed_in_the_cavities_as_they_are(twins, mesh, sealed, changed) -> None:
    (gas,) = model_at(sealed, mesh, jnp.asarray(changed)).actuators
    assert isinstance(gas, SealedGas)
    exact = Cavity(jnp.asarray(mesh.walls[1].faces))(mesh.rest(jnp.asarray(changed)))
    np.testing.assert_allclose(gas.rest, [exact], rtol=1e-12)


def test_a_device_on_another_mesh_is_refused(twins, mesh, twin_mesh, sealed) -> None:
    with pytest.raises(SoftfuseError, match="nodes, the layout's mesh"):
        model_at(sealed, twin_mesh, jnp.asarray(twins.start))
