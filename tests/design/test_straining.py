"""Largest stretches and strains are those of singular values and eigenvalues."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.body import Body
from softfuse.design.straining import largest_strain, largest_stretch
from softfuse.robot.file import load
from softfuse.robot.robot import build_robot


@pytest.fixture(scope="module")
def body(coarse) -> Body:
    """The pad on the coarsest mesh."""
    made = build_robot(load(coarse)).model.body
    assert isinstance(made, Body)
    return made


@pytest.fixture(scope="module")
def z(body) -> jnp.ndarray:
    """Unknowns without an order."""
    return jnp.asarray(1e-4 * np.random.default_rng(0).standard_normal(body.n))


def deformations(body: Body, z: jnp.ndarray) -> np.ndarray:
    (region,) = body.regions()
    f = np.array(region.deformation(region.strains(jnp.append(z, 0.0))[0]))
    return np.moveaxis(f, (0, 1), (2, 3))


def test_the_largest_stretch_is_the_largest_singular_value_of_f(body, z) -> None:
    singular = np.linalg.svd(deformations(body, z), compute_uv=False)
    np.testing.assert_allclose(largest_stretch(body, z), singular.max(), rtol=1e-12)


def test_the_largest_strain_is_the_largest_eigenvalue(body, z) -> None:
    slope = deformations(body, z) - np.eye(3)
    eigenvalues = np.linalg.eigvalsh(0.5 * (slope + np.swapaxes(slope, 2, 3)))
    np.testing.assert_allclose(largest_strain(body, body.displacement(z)), eigenvalues.max(), rtol=1e-10)


def test_the_largest_strain_has_derivatives_where_other_points_have_no_strain(body, z) -> None:
    free = int(np.flatnonzero((np.asarray(body.displacement_index) < body.n).all(axis=1))[0])
    moved = jnp.zeros_like(body.rest).at[free].set(1e-4 * jnp.array([1.0, 2.0, 3.0]))
    along = jnp.asarray(np.random.default_rng(1).standard_normal(moved.shape))

    def strain(step):
        return largest_strain(body, moved + step * along)

    step = 1e-9
    difference = (strain(step) - strain(-step)) / (2 * step)
    assert jax.grad(strain)(0.0) == pytest.approx(float(difference), rel=1e-5)
