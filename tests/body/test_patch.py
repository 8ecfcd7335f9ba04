"""Patch test and rigid motions: constant strain is exact, and motion without strain costs nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softfuse.body import ELEMENTS, LINEAR, TAYLOR_HOOD, Body, mesh_for
from softfuse.material import NeoHookean

_lagrangian, _residual = jax.jit(Body.lagrangian), jax.jit(Body.residual)
YOUNG, SIZE = 6e5, 0.03
GRADIENT = np.array([[0.15, 0.2, -0.05], [0.1, -0.2, 0.1], [0.05, -0.1, 0.1]])


@pytest.fixture(scope="module", params=sorted(ELEMENTS))
def body(request, irregular) -> Body:
    """An irregular cube that only its corner at 0 holds."""
    element = ELEMENTS[request.param]
    mesh = mesh_for(element, irregular(2, SIZE))
    held = np.all(mesh.nodes == 0.0, axis=1)
    return Body.from_mesh(mesh, [NeoHookean.from_young(YOUNG, 0.45)], held, element=element)


def _unknowns(body: Body, displacement: np.ndarray) -> np.ndarray:
    z = np.zeros(body.n + 1)
    z[np.asarray(body.displacement_index)] = displacement
    return z[:-1]


def _on_boundary(body: Body) -> np.ndarray:
    rest = np.asarray(body.rest)
    return np.any((rest == 0.0) | (rest == SIZE), axis=1)


def test_affine_boundary_gives_a_homogeneous_body(body, equilibrate) -> None:
    law = body.materials[0]
    exact = np.asarray(body.rest) @ GRADIENT.T
    index = np.asarray(body.displacement_index)
    held = np.append(np.zeros(body.n, bool), True)
    held[index[_on_boundary(body)]] = True
    start = _unknowns(body, exact * _on_boundary(body)[:, None])
    z = equilibrate(body, start, np.flatnonzero(~held[:-1]))
    np.testing.assert_allclose(body.displacement(jnp.asarray(z)), exact, atol=1e-13 * SIZE)
    f = np.eye(3) + GRADIENT
    np.testing.assert_allclose(body.volume_ratios(jnp.asarray(z)), np.linalg.det(f), rtol=1e-12)
    pressure = float(body.pressure_unit) * z[body.n_displacements :]
    np.testing.assert_allclose(pressure, float(law.lame) * np.log(np.linalg.det(f)), rtol=1e-11)
    energy = float(law.energy(jnp.asarray(f))) * SIZE**3
    np.testing.assert_allclose(_lagrangian(body, jnp.asarray(z)), energy, rtol=1e-12)


def test_affine_state_loads_the_surface_by_its_exact_stress(body) -> None:
    """Inner nodes carry nothing and Σ f ⊗ X = P V, P = μ (F − F⁻ᵀ) + λ ln J F⁻ᵀ (virtual work)."""
    law = body.materials[0]
    f = np.eye(3) + GRADIENT
    inverse_t = np.linalg.inv(f).T
    log_j = np.log(np.linalg.det(f))
    stress = float(law.mu) * (f - inverse_t) + float(law.lame) * log_j * inverse_t
    z = _unknowns(body, np.asarray(body.rest) @ GRADIENT.T)
    z[body.n_displacements :] = float(law.lame) * log_j / float(body.pressure_unit)
    force = np.append(np.asarray(_residual(body, jnp.asarray(z))), 0.0)[np.asarray(body.displacement_index)]
    inside = ~_on_boundary(body)
    np.testing.assert_allclose(force[inside], 0.0, atol=1e-12 * YOUNG * SIZE**2)
    rest = np.asarray(body.rest)
    np.testing.assert_allclose(force.T @ rest, stress * SIZE**3, rtol=1e-10, atol=1e-12 * YOUNG * SIZE**3)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.0, 0.0, 3.0), (1.1, -0.7, 2.3)])
def test_rigid_motion_costs_no_energy_and_no_force(irregular, turn) -> None:
    for element in ELEMENTS.values():
        mesh = mesh_for(element, irregular(2, SIZE))
        held = np.zeros(len(mesh.nodes), bool)
        held[0] = True
        body = Body.from_mesh(mesh, [NeoHookean.from_young(YOUNG, 0.49)], held, element=element)
        rotation = Rotation.from_rotvec(turn).as_matrix()
        centre = mesh.nodes[0]  # the held node stays in place ...
        moved = (mesh.nodes - centre) @ (rotation - np.eye(3)).T
        z = jnp.asarray(_unknowns(body, moved))
        assert abs(float(_lagrangian(body, z))) < 1e-13 * YOUNG * SIZE**3
        assert float(jnp.max(jnp.abs(_residual(body, z)))) < 1e-13 * YOUNG * SIZE**2
        # ... and the material's frame is free: the same body, shifted at rest, behaves the same.
        shifted = body.with_rest(body.rest + jnp.array([1.0, -2.0, 3.0]))
        assert float(jnp.max(jnp.abs(_residual(shifted, z)))) < 1e-11 * YOUNG * SIZE**2


def test_forces_of_a_deformed_body_balance(irregular) -> None:
    """Translation costs nothing: the forces on all nodes, the held one included, sum to zero."""
    mesh = mesh_for(LINEAR, irregular(2, SIZE))
    law = NeoHookean.from_young(YOUNG, 0.49)
    nodes = np.arange(len(mesh.nodes))
    first, last = (Body.from_mesh(mesh, [law], nodes == k, element=LINEAR) for k in (0, len(nodes) - 1))
    moved = np.random.default_rng(0).normal(size=mesh.nodes.shape) * 0.01 * SIZE
    # Each body gives the forces on its own free nodes, in the same shape but for a translation.
    forces = []
    for body, held in ((first, 0), (last, -1)):
        z = jnp.asarray(_unknowns(body, moved - moved[held]))
        forces.append(np.append(_residual(body, z), 0.0)[np.asarray(body.displacement_index)])
    assert np.abs(forces[0]).max() > 1e-3 * YOUNG * SIZE**2
    np.testing.assert_allclose(forces[0][1:-1], forces[1][1:-1], atol=1e-13 * YOUNG * SIZE**2)
    np.testing.assert_allclose(forces[0].sum(axis=0) + forces[1][0], 0.0, atol=1e-12 * YOUNG * SIZE**2)


@pytest.mark.slow
def test_layers_of_two_materials_are_exact(box, equilibrate) -> None:
    """A soft layer under a stiff one, confined sideways: one stress, two strains, a pressure that jumps."""
    planes = [np.array([0.0, 0.4, 1.0]) * SIZE] * 2 + [np.array([0.0, 0.35, 0.5, 1.0]) * SIZE]
    mesh = mesh_for(TAYLOR_HOOD, box(planes))
    stiff = mesh.nodes[mesh.tets[:, :4]].mean(axis=1)[:, 2] > 0.5 * SIZE
    mesh = type(mesh)(mesh.nodes, mesh.tets, stiff.astype(np.int32))
    laws = [NeoHookean.from_young(YOUNG, 0.49), NeoHookean.from_young(20 * YOUNG, 0.3)]
    body = Body.from_mesh(mesh, laws, mesh.nodes[:, 2] == 0.0)
    strains = np.array([0.9, np.nan])
    traction = _confined_stress(laws[0], strains[0])
    low, high = strains[0], 1.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _confined_stress(laws[1], middle) < traction else (low, middle)
    strains[1] = low
    height = mesh.nodes[:, 2]
    exact = np.zeros_like(mesh.nodes)
    exact[:, 2] = (strains[0] - 1) * np.minimum(height, 0.5 * SIZE)
    exact[:, 2] += (strains[1] - 1) * np.maximum(height - 0.5 * SIZE, 0.0)
    index = np.asarray(body.displacement_index)
    held = np.zeros(body.n + 1, bool)
    sides = np.any((mesh.nodes[:, :2] == 0.0) | (mesh.nodes[:, :2] == SIZE), axis=1)
    held[index[sides, :2]] = True
    held[index[height == SIZE, 2]] = True
    z = equilibrate(body, _unknowns(body, exact * (height == SIZE)[:, None]), np.flatnonzero(~held[:-1]))
    np.testing.assert_allclose(body.displacement(jnp.asarray(z)), exact, atol=1e-12 * SIZE)
    region = np.repeat(np.arange(2), body.counts)
    pressures = float(body.pressure_unit) * z[np.asarray(body.element_unknowns)[:, 30:]]
    expected = np.array([float(law.lame) * np.log(s) for law, s in zip(laws, strains, strict=True)])
    np.testing.assert_allclose(pressures, np.repeat(expected[region][:, None], 4, axis=1), rtol=1e-9)
    assert abs(expected[0] - expected[1]) > 0.1 * abs(expected[0])
    shared = np.intersect1d(mesh.tets[stiff][:, :4], mesh.tets[~stiff][:, :4])
    assert body.n - body.n_displacements == mesh.n_corners + len(shared)


def _confined_stress(law: NeoHookean, s: float) -> float:
    return float(law.mu) * (s - 1 / s) + float(law.lame) * np.log(s) / s
