"""What holds a body, against the internal forces of its elements at the held nodes."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softfuse.body import QUADRATIC, Body, mesh_for
from softfuse.errors import SolveError
from softfuse.functional import Cavity, flat_punch, uniform
from softfuse.functional.pressure_cells import even
from softfuse.functional.skin import Skin
from softfuse.material import NeoHookean
from softfuse.mechanics import LinearPorts, Loads, Newton, PrescribedForce, State, solve
from softfuse.mechanics.cable import PulledCable
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.indenters import FlatIndenter, SphereIndenter, SurfacePatches
from softfuse.mechanics.reaction import Reaction
from softfuse.mechanics.solution import RESULTS
from softfuse.mesh.kuhn import kuhn_grid
from softfuse.mesh.orientation import oriented
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.mesh.tetmesh import tet_mesh

ORIGIN = jnp.array([0.003, -0.01, 0.02])
TURN = jnp.asarray(Rotation.from_rotvec([0.5, -0.3, 1.0]).as_matrix())


@pytest.fixture(scope="module")
def finger() -> tuple[Body, Cavity, np.ndarray]:
    """A beam of 40 x 12 x 12 mm with a void, heavy, held at its left end."""
    planes = (np.array([0, 8, 16, 24, 40]), np.array([0, 4, 8, 12]), np.array([0, 4, 8, 12]))
    keep = np.ones((4, 3, 3), bool)
    keep[2, 1, 1] = False
    x, y, z = (1e-3 * np.asarray(each, float) for each in planes)
    grid = kuhn_grid((x, y, z), keep, (0, 0, 0))
    mesh = mesh_for(QUADRATIC, oriented(tet_mesh(grid.nodes, grid.tets)))
    body = Body.from_mesh(
        mesh,
        [NeoHookean.from_young(2e5, 0.4)],
        mesh.nodes[:, 0] == 0.0,
        element=QUADRATIC,
        densities=[1070.0],
        gravity=(1.0, -2.0, -9.0),
    )
    return body, Cavity(jnp.asarray(cavities(mesh)[0].faces)), outer_surface(mesh).faces


def _held(body: Body, z: jnp.ndarray, pushed: np.ndarray) -> np.ndarray:
    """Force and moment about the world's origin on the held nodes: internal forces of all nodes, from the
    energy of all nodes' positions, minus gravity's and the loads' own parts on held nodes, `pushed` (k, 3).
    """
    n = 3 * body.n_nodes
    index = jnp.arange(n).reshape(-1, 3)
    free = replace(
        body,
        displacement_index=index,
        displacement_unknowns=index[body.tets].transpose(2, 1, 0),
        weight=jnp.zeros(n),
        n_displacements=n,
        n=n,
    )
    u = np.asarray(body.displacement(z))
    internal = np.asarray(jax.jit(type(free).residual)(free, jnp.asarray(u.ravel()))).reshape(-1, 3)
    weights = np.asarray(body.masses())[:, None] * np.asarray(body.gravity)
    support = internal - weights - pushed
    held = np.all(np.asarray(body.displacement_index) >= body.n, axis=1)
    np.testing.assert_allclose(support[~held], 0.0, atol=1e-6)
    x = np.asarray(body.rest) + u
    return np.concatenate([support[held].sum(axis=0), np.cross(x[held], support[held]).sum(axis=0)])


def _solved(body: Body, loads: Loads, drive: list[float]) -> State:
    found = eqx.filter_jit(solve)(
        Newton(Dense.plan(body)), body, loads, jnp.array(drive), State.rest(body, loads)
    )
    assert found.result == RESULTS.converged
    return found.state


@pytest.mark.slow
def test_support_is_what_the_elements_pass_on(finger) -> None:
    """Under gravity, a punch, a sphere, patches, a cable and gas, none of which pushes a held node."""
    body, void, faces = finger
    rest = np.asarray(body.rest)
    skin = Skin.of(faces, rest, 5e-3)
    places = skin.places_at(
        rest, np.array([[0.03, 0.006, 0.02], [0.02, 0.02, 0.006], [0.033, 0.006, -0.01]]), along=(1, 0, 0)
    )
    contacts = (
        FlatIndenter(skin, flat_punch((0.6, 1.0), (4, 8)), 3e-3),
        SphereIndenter(skin, even((0.4, 1.0), (4, 8)), 6e-3, 3e-3),
        SurfacePatches(skin, uniform(rings=3, angles=8), 2e-3),
    )
    cable = PulledCable.through(
        body, np.array([[0.012, 0.002, 0.006], [0.036, 0.002, 0.006]]), np.array([-0.01, 0.002, 0.004])
    )
    parts = [contact.load(body, jnp.asarray(place)) for contact, place in zip(contacts, places, strict=True)]
    loads = Loads((*parts, cable, SealedGas.of((void,), body, jnp.array([1e-6]))))
    state = _solved(body, loads, [0.3, 0.2, 0.25, 1.0, 1.2e5])
    held = _held(body, state.z, _pushes(body, loads, state))
    at = np.asarray(Reaction(jnp.zeros(3), jnp.eye(3)).value(body, loads, state))
    np.testing.assert_allclose(at[:3], held[:3], atol=1e-7)
    np.testing.assert_allclose(at[3:], held[3:], atol=1e-9)
    # In another frame, and what a cable that is pulled on the same side does not add.
    moved = np.asarray(Reaction(ORIGIN, TURN).value(body, loads, state))
    np.testing.assert_allclose(moved[:3], TURN.T @ at[:3], atol=1e-12)
    np.testing.assert_allclose(moved[3:], TURN.T @ (at[3:] - jnp.cross(ORIGIN, at[:3])), atol=1e-12)
    inside = np.asarray(Reaction(jnp.zeros(3), jnp.eye(3), internal=(3,)).value(body, loads, state))
    np.testing.assert_allclose(np.linalg.norm(inside[:3] - at[:3]), 1.0, rtol=1e-6)


def _pushes(body: Body, loads: Loads, state: State) -> np.ndarray:
    """What the loads do to free nodes (k, 3) [N]."""
    nodal = np.append(np.asarray(loads.push(body, state.z, state.force)), 0.0)
    return nodal[np.minimum(np.asarray(body.displacement_index), body.n)]


@pytest.mark.slow
def test_support_carries_what_presses_on_held_nodes_too(finger) -> None:
    """A disc over the held end: half of its force never strains the body, and is held all the same."""
    body, _, faces = finger
    skin = Skin.of(faces, np.asarray(body.rest), 5e-3)
    place = skin.places_at(np.asarray(body.rest), np.array([[0.004, 0.006, 0.02]]), along=(1, 0, 0))[0]
    loads = Loads((FlatIndenter(skin, flat_punch((0.6, 1.0), (4, 8)), 3e-3).load(body, jnp.asarray(place)),))
    state = _solved(body, loads, [0.5])
    found = np.asarray(Reaction(jnp.zeros(3), jnp.eye(3)).value(body, loads, state))
    weight = np.asarray(body.weight_resultant(state.z))[:3]
    np.testing.assert_allclose(found[:3] + weight, [0.0, 0.0, 0.5], atol=1e-7)
    assert 0.0 > _pushes(body, loads, state)[:, 2].sum() > -0.45


def test_rows_alone_have_no_resultant(finger) -> None:
    body = finger[0]
    loads = Loads((PrescribedForce.on(LinearPorts(jnp.zeros(1), jnp.ones((body.n, 1))), body, jnp.ones(1)),))
    with pytest.raises(SolveError, match="is not known"):
        Reaction(jnp.zeros(3), jnp.eye(3)).value(body, loads, State.rest(body, loads))
