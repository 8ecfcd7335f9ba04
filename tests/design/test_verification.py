"""Presses of a real force: at a small one they are the answers at rest, and strains grow with it."""

import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.config import load
from softfuse.config.build_device import build_device
from softfuse.config.build_mesh import build_mesh
from softfuse.design.verification import largest_stretch, pressed
from softfuse.errors import SolveError
from softfuse.estimation.rest_response import rest_response

PLACES = jnp.array([[0.012, -0.015, 0.0], [-0.01, 0.016, 0.0]])


@pytest.fixture(scope="module")
def pad(coarse):
    """The pad on the coarsest mesh."""
    config = load(coarse)
    mesh = build_mesh(config)
    return build_device(config, mesh), [wall.faces for wall in mesh.cavities]


def test_a_small_force_is_answered_as_at_rest(pad) -> None:
    device, walls = pad
    counted = []
    found = pressed(device, walls, PLACES, 1e-3, seen=lambda: counted.append(1))
    answer = rest_response(device, PLACES)
    size = float(jnp.max(jnp.abs(answer.by_force)))
    np.testing.assert_allclose(found.by_force, answer.by_force, rtol=0, atol=1e-3 * size)
    np.testing.assert_allclose(found.softness, answer.softness, rtol=1e-3)
    np.testing.assert_allclose(found.open_part, 1.0, atol=1e-3)
    np.testing.assert_allclose(found.stretch, 1.0, atol=1e-3)
    assert len(counted) == len(PLACES)


def test_harder_presses_close_cavities_and_stretch_walls(pad) -> None:
    device, walls = pad
    soft, hard = (pressed(device, walls, PLACES, force) for force in (1.0, 5.0))
    assert (hard.open_part < soft.open_part).all() and (hard.open_part > 0.0).all()
    assert (hard.stretch > soft.stretch).all() and (soft.stretch > 1.0).all()


def test_the_largest_stretch_is_the_largest_singular_value_of_f(pad) -> None:
    body = pad[0].body
    z = jnp.asarray(1e-4 * np.random.default_rng(0).standard_normal(body.n))
    (region,) = body.regions()
    f = np.moveaxis(np.array(region.deformation(region.strains(jnp.append(z, 0.0))[0])), (0, 1), (2, 3))
    singular = np.linalg.svd(f, compute_uv=False)
    np.testing.assert_allclose(largest_stretch(body, z), singular.max(), rtol=1e-12)


def test_a_press_without_equilibrium_is_told(pad) -> None:
    device, walls = pad
    with pytest.raises(SolveError, match="no equilibrium under 5000 N"):
        pressed(device, walls, PLACES[:1], 5000.0)
