"""A patch pressed along its current normal: the force turns with the body, however far it bends."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import LINEAR, Body, mesh_for
from softfuse.functional.chart import facing
from softfuse.functional.pressure_cells import uniform
from softfuse.functional.skin import Skin
from softfuse.material import NeoHookean
from softfuse.mechanics import RESULTS, Loads, Newton, State, solve
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.indenters import SurfacePatches
from softfuse.mechanics.patch import NormalPatches
from softfuse.mesh.surface import boundary_faces
from softfuse.mesh.tetmesh import tet_mesh

LENGTH, SIDE = 0.06, 0.012
AT = np.array([0.048, SIDE, 0.006])

_solve = eqx.filter_jit(solve)


@pytest.fixture(scope="module")
def beam(box) -> Body:
    """60 × 12 × 12 mm, held at x = 0."""
    mesh = mesh_for(LINEAR, box(np.linspace(0, LENGTH, 11), *(2 * [np.linspace(0, SIDE, 3)])))
    return Body.from_mesh(mesh, [NeoHookean.from_young(3e5, 0.3)], mesh.nodes[:, 0] == 0.0, element=LINEAR)


@pytest.fixture(scope="module")
def skin(beam) -> np.ndarray:
    return boundary_faces(tet_mesh(np.asarray(beam.rest), np.asarray(beam.tets))).faces


@pytest.fixture(scope="module")
def contact(beam, skin) -> SurfacePatches:
    """One patch."""
    return SurfacePatches(Skin.of(skin, np.asarray(beam.rest), 4.5e-3), uniform(rings=3, angles=8), 3e-3)


@pytest.fixture(scope="module")
def patch(beam, contact) -> NormalPatches:
    """It on the upper side in y, near the end."""
    return contact.load(beam, jnp.asarray(facing(AT, (0, -1, 0))))


def _turned(body: Body, angle: float) -> tuple[jnp.ndarray, np.ndarray]:
    """Unknowns (n,) of the body, its held end aside, turned by an angle; and the rotation."""
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    moved = np.asarray(body.rest) @ turn.T - np.asarray(body.rest)
    z = np.zeros(body.n + 1)
    z[np.asarray(body.displacement_index)] = moved
    return jnp.asarray(z[:-1]), turn


def test_a_turned_body_is_pressed_in_the_turned_direction(beam, patch) -> None:
    z, turn = _turned(beam, 1.1)
    y = patch.ports.values(beam, z)
    inwards, none, drive = np.array([0.0, -1.0, 0.0]), jnp.zeros(0), jnp.array([2.0])
    turned = patch.equations(jnp.asarray(2.0 * turn @ inwards), none, y, drive)
    np.testing.assert_allclose(turned, 0.0, atol=1e-12)
    np.testing.assert_allclose(y[:3], turn @ AT, atol=1e-12)
    assert float(jnp.linalg.norm(patch.equations(jnp.asarray(2.0 * inwards), none, y, drive))) > 0.5


def test_what_answers_a_force_is_the_way_along_the_normal(beam, patch) -> None:
    shift = jnp.tile(jnp.array([1e-3, -2e-3, 3e-3]), (beam.rest.shape[0], 1))
    z = jnp.zeros(beam.n + 1).at[beam.displacement_index].set(shift)[:-1]
    y = patch.ports.values(beam, z)
    np.testing.assert_allclose(patch.conjugate(jnp.zeros(3), jnp.zeros(0), y), [2e-3], rtol=1e-12)


def _pressed(body: Body, load: NormalPatches, force: float):
    loads = Loads((load,))
    newton = Newton(Dense.plan(body))
    return _solve(newton, body, loads, jnp.array([force]), State.rest(body, loads))


def test_the_force_stands_on_the_bent_surface(beam, skin, patch) -> None:
    """Against the normal of its triangles as they are: the beam has bent by over 40 degrees."""
    found = _pressed(beam, patch, 0.6)
    assert found.result == RESULTS.converged
    force = np.asarray(found.state.force)
    np.testing.assert_allclose(np.linalg.norm(force), 0.6, rtol=1e-9)
    x = np.asarray(beam.rest + beam.displacement(found.state.z))
    rest = np.asarray(beam.rest)[skin]
    under = np.all(np.abs(rest[..., 1] - SIDE) < 1e-9, axis=1)
    under &= np.linalg.norm(rest.mean(axis=1) - AT, axis=1) < 7e-3
    corner = x[skin[under]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    assert np.degrees(np.arccos(normal[1])) > 40
    assert np.degrees(np.arccos(-normal @ force / np.linalg.norm(force))) < 3


@pytest.mark.slow
def test_the_derivative_in_the_force_is_that_of_finite_differences(beam, patch) -> None:
    """The turning of the force is part of it; without, it would be off by far more than the tolerance."""

    def moved(force):
        loads = Loads((patch,))
        state = solve(Newton(Dense.plan(beam)), beam, loads, force[None], State.rest(beam, loads)).state
        return loads.conjugate(state.force, state.internal, loads.values(beam, state.z))[0]

    at, step = jnp.array(0.4), 1e-4
    _, slope = jax.jit(lambda f: jax.jvp(moved, (f,), (jnp.ones(()),)))(at)
    differences = (jax.jit(moved)(at + step) - jax.jit(moved)(at - step)) / (2 * step)
    np.testing.assert_allclose(slope, differences, rtol=1e-6)
