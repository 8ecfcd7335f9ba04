"""Enclosed volume of curved faces: exact, invariant under rigid motion; its gradient is the pressure's force.

A quadratic map x(X) of a box with straight edges is represented exactly by quadratic faces, and the volume
that they enclose is ∫ det ∂x/∂X over the box: a polynomial that Gauss points integrate exactly.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from softfuse.functional.cavity import Cavity
from softfuse.mesh.surface import boundary_faces, cavities, enclosed_volume
from softfuse.mesh.tetmesh import quadratic

SIZE = 0.03
LOW, HIGH = np.array([0.009, 0.012, 0.006]), np.array([0.021, 0.018, 0.024])
_volume = jax.jit(lambda faces, positions: Cavity(faces)(positions))
_gradient = jax.jit(jax.grad(lambda positions, faces: Cavity(faces)(positions)))


def _curved(seed: int, bend: float = 0.15) -> tuple[np.ndarray, np.ndarray]:
    """A (3, 3) and B (3, 3, 3) of the map x = A X + X · B X / SIZE, a generic one without folds."""
    random = np.random.default_rng(seed)
    b = random.uniform(-bend, bend, (3, 3, 3))
    return np.eye(3) + random.uniform(-0.2, 0.2, (3, 3)), 0.5 * (b + b.swapaxes(1, 2))


def _map(a, b, points):
    return points @ a.T + np.einsum("ijk,pj,pk->pi", b, points, points) / SIZE


def _mapped_volume(a, b, low, high) -> float:
    """∫ det ∂x/∂X over the box [low, high], degree 3: two Gauss points an axis."""
    t = np.array([-1.0, 1.0]) / np.sqrt(3.0)
    unit = np.stack(np.meshgrid(t, t, t, indexing="ij"), -1).reshape(-1, 3)
    points = 0.5 * (low + high) + 0.5 * (high - low) * unit
    slopes = a + 2 * np.einsum("ijk,pk->pij", b, points) / SIZE
    return float(np.prod(high - low) * np.linalg.det(slopes).mean())


@pytest.fixture(scope="module")
def hollow(box):
    """A quadratic mesh of a cube with a closed box [LOW, HIGH] left out, and the faces of that cavity."""
    keep = np.ones((3, 3, 3), bool)
    keep[1, 1, 1] = False
    planes = [np.array([0.0, lo, hi, SIZE]) for lo, hi in zip(LOW, HIGH, strict=True)]
    mesh = quadratic(box(*planes, keep=keep))
    return mesh.nodes, cavities(mesh)[0].faces


@pytest.mark.parametrize("seed", range(4))
def test_curved_cavity_is_exact_where_flat_triangles_are_not(hollow, seed) -> None:
    nodes, faces = hollow
    a, b = _curved(seed)
    moved = _map(a, b, nodes)
    exact = _mapped_volume(a, b, LOW, HIGH)
    np.testing.assert_allclose(_volume(faces, moved), exact, rtol=1e-13)
    # What the mid-edge nodes contribute is far above the tolerance.
    assert abs(enclosed_volume(moved, faces) / exact - 1) > 1e-5


def test_a_skin_encloses_body_and_cavity(hollow, box) -> None:
    mesh = quadratic(box(*[np.array([0.0, 0.4, 1.0]) * SIZE] * 3))
    a, b = _curved(11)
    exact = _mapped_volume(a, b, np.zeros(3), np.full(3, SIZE))
    np.testing.assert_allclose(_volume(boundary_faces(mesh).faces, _map(a, b, mesh.nodes)), exact, rtol=1e-13)


def test_linear_faces_are_flat_triangles(box) -> None:
    mesh = box(*[np.array([0.0, 0.4, 1.0]) * SIZE] * 3)
    faces = boundary_faces(mesh).faces
    a, _ = _curved(3)
    np.testing.assert_allclose(_volume(faces, mesh.nodes @ a.T), np.linalg.det(a) * SIZE**3, rtol=1e-13)
    shaken = mesh.nodes + np.random.default_rng(0).uniform(-0.1, 0.1, mesh.nodes.shape) * SIZE
    np.testing.assert_allclose(_volume(faces, shaken), enclosed_volume(shaken, faces), rtol=1e-13)


@settings(max_examples=20)
@given(
    st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3)
)
def test_rigid_motion_leaves_the_volume(hollow, turn, shift) -> None:
    nodes, faces = hollow
    moved = _map(*_curved(1), nodes)
    turned = moved @ Rotation.from_rotvec(turn).as_matrix().T + np.array(shift)
    np.testing.assert_allclose(_volume(faces, turned), _volume(faces, moved), rtol=1e-11)


def test_turned_faces_enclose_the_negative(hollow) -> None:
    nodes, faces = hollow
    moved = _map(*_curved(2), nodes)
    turned = faces[:, [0, 2, 1, 5, 4, 3]]
    np.testing.assert_allclose(_volume(turned, moved), -_volume(faces, moved), rtol=1e-13)


def test_gradient_is_that_of_differences(hollow) -> None:
    nodes, faces = hollow
    moved = _map(*_curved(4), nodes)
    gradient = np.asarray(_gradient(moved, faces))
    random = np.random.default_rng(5)
    for _ in range(4):
        d = random.normal(size=nodes.shape)
        step = 1e-5 * SIZE
        difference = (_volume(faces, moved + step * d) - _volume(faces, moved - step * d)) / (2 * step)
        np.testing.assert_allclose(np.sum(gradient * d), difference, rtol=1e-8)


def test_gradient_is_the_force_of_unit_pressure(hollow) -> None:
    """It is in balance, turns nothing, spends 3 V on a swelling (homogeneity) and spares other nodes."""
    nodes, faces = hollow
    moved = _map(*_curved(6), nodes)
    gradient = np.asarray(_gradient(moved, faces))
    area = SIZE**2
    np.testing.assert_allclose(gradient.sum(axis=0), 0.0, rtol=0, atol=1e-14 * area)
    np.testing.assert_allclose(np.cross(moved, gradient).sum(axis=0), 0.0, rtol=0, atol=1e-14 * area * SIZE)
    np.testing.assert_allclose(np.sum(moved * gradient), 3 * _volume(faces, moved), rtol=1e-12)
    assert np.all(gradient[np.setdiff1d(np.arange(len(nodes)), faces)] == 0.0)
    # At rest the walls are plane: the force on each is its area, in thirds on the middles of its edges.
    rest = np.asarray(_gradient(nodes, faces))
    wall = np.isclose(nodes[:, 0], HIGH[0]) & np.isin(np.arange(len(nodes)), faces)
    np.testing.assert_allclose(rest[wall, 0].sum(), np.prod((HIGH - LOW)[1:]), rtol=1e-12)


def test_curvature_of_the_volume_is_symmetric_and_batched(hollow) -> None:
    """Hessian-vector products by vmap of forward over reverse: u · H v = v · H u."""
    nodes, faces = hollow
    moved = jnp.asarray(_map(*_curved(7), nodes))
    directions = jnp.asarray(np.random.default_rng(8).normal(size=(3, *nodes.shape)))

    @jax.jit
    @jax.vmap
    def curvature(v):
        return jax.jvp(lambda x: _gradient(x, faces), (moved,), (v,))[1]

    bilinear = np.einsum("aki,bki->ab", directions, curvature(directions))
    np.testing.assert_allclose(bilinear, bilinear.T, rtol=1e-11, atol=1e-14 * SIZE)
    assert np.linalg.norm(bilinear) > 0.01 * SIZE
